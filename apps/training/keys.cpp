// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <memory>
#include <vector>

#include "apps/commands.h"
#include "sim/base/output_paths.h"
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
  check_outputs(std::vector<OutputPath>{{"FILE", options.file}});
  const CurveKeys keys = make_curve_keys();
  write_curve_keys(options.file, keys);
  fmt::print("{}\n", keys.public_key);
}

}  // namespace

void add_keys(CLI::App& app) {
  const auto options = std::make_shared<KeysArguments>();
  CLI::App* command = app.add_subcommand("keys", "Generate CURVE encryption keys for workers on several hosts, and print the public key");
  command->add_option("FILE", options->file, "File to write the keys to (mode 0600)")->required();
  command->add_flag("--show", options->show, "Print the public key of an existing file");
  command->footer(
      "Simplest setup: copy one key file to every host under the same path and set network.curve_key_file=FILE.\n"
      "Separate keys per host: network.allow_list is a file with all public keys, network.meeting_key the public key of rank 0.\n"
      "Details: docs/howto/hosts.md.");
  command->callback([options] { run_keys(*options); });
}

}  // namespace earshot
