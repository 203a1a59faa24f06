#include <fmt/format.h>

#include <memory>

#include "apps/commands.h"
#include "trainer/net/curve_keys.h"

namespace earshot {
namespace {

struct KeysArguments {
  std::string file;
  bool show = false;
};

void run_keys(const KeysArguments& options) {
  if (options.show) {
    fmt::print("{}\n", read_curve_keys(options.file).public_key);
    return;
  }
  const CurveKeys keys = make_curve_keys();
  write_curve_keys(options.file, keys);
  fmt::print("{}\n", keys.public_key);
}

}  // namespace

void add_keys(CLI::App& app) {
  const auto options = std::make_shared<KeysArguments>();
  CLI::App* command = app.add_subcommand("keys", "Make CURVE keys for workers on several hosts, and print the public one");
  command->add_option("FILE", options->file, "New file for the keys, mode 0600")->required();
  command->add_flag("--show", options->show, "Print the public key of a file that is there");
  command->footer(
      "The simplest: one file for all workers of a run, on every host under the same name, network.curve_key_file=FILE.  With a file per\n"
      "host, network.allow_list names a file of all public keys and network.meeting_key is that of rank 0: docs/howto/hosts.md.");
  command->callback([options] { run_keys(*options); });
}

}  // namespace earshot
