// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <memory>

#include "apps/commands.h"
#include "apps/options/output_options.h"
#include "apps/reference/config_pages.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

struct ConfigArguments {
  std::string key, json;
  bool markdown = false;
};

/// Width of the terminal in characters; 100 without a terminal.
std::size_t terminal_width() {
  constexpr std::size_t without_terminal = 100;
  winsize size{};
  if (::isatty(STDOUT_FILENO) == 0 || ::ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0) return without_terminal;
  return size.ws_col;
}

void run_config(const ConfigArguments& options) {
  const std::vector<ConfigKind> reference = config_reference();
  std::string text;
  if (options.markdown)
    text = reference_markdown(reference);
  else if (options.key.empty())
    text = reference_text(reference, terminal_width());
  else
    text = key_text(reference, options.key, terminal_width());
  if (text.empty()) {
    const std::string nearest = nearest_key(reference, options.key);
    throw InputError(options.key, "is not a key of any config",
                     nearest.empty() ? "'earshot config' prints all keys" : "did you mean '" + nearest + "'?");
  }
  if (!options.json.empty()) write_file_atomically(options.json, reference_json(reference, options.key));
  fmt::print("{}", text);
}

}  // namespace

void add_config(CLI::App& app) {
  auto options = std::make_shared<ConfigArguments>();
  CLI::App* command = app.add_subcommand("config", "Print the keys of config files with their types, defaults, units and ranges");
  auto* key = command->add_option("KEY", options->key, "A key (ppo.clip), a section (ppo) or a kind of file (scene); without it all keys");
  command->add_flag("--markdown", options->markdown, "Print the page of the documentation")->excludes(key);
  command->add_option("--json", options->json, "Also write the keys to this JSON file")->type_name(kOutputFile);
  command->footer(
      "earshot config env.acoustics.rays    one key\nearshot config ppo                    a section\nearshot config \"run config\"        "
      "   a kind of file");
  command->callback([options] { run_config(*options); });
}

}  // namespace earshot
