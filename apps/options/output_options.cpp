// SPDX-License-Identifier: Apache-2.0
#include "apps/options/output_options.h"

#include <algorithm>
#include <filesystem>
#include <system_error>
#include <vector>

#include "sim/base/output_paths.h"

namespace earshot {
namespace {

/// What is given, or the default.
std::vector<std::string> values_of(const CLI::Option& option) {
  if (option.count() > 0) return option.results();
  if (option.get_default_str().empty()) return {};
  return {option.get_default_str()};
}

/// All files and folders that a value may name: itself, FILE of "FILE,unit=0.01", and FILE of "key=FILE".
void add_inputs(const CLI::Option& option, const std::string& value, std::vector<InputPath>& inputs) {
  const bool is_read_whole = option.get_type_name().ends_with(kWholeFolder);
  std::vector<std::string> names{value, value.substr(0, value.find(','))};
  for (std::size_t equals = value.find('='); equals != std::string::npos; equals = value.find('=', equals + 1))
    names.push_back(value.substr(equals + 1));
  std::ranges::sort(names);
  const auto repeated = std::ranges::unique(names);
  names.erase(repeated.begin(), repeated.end());
  for (const std::string& name : names) {
    std::error_code error;
    if (!name.empty() && std::filesystem::exists(name, error)) inputs.push_back({option.get_name(), name, is_read_whole});
  }
}

void check_command(const CLI::App& command) {
  std::vector<OutputPath> outputs;
  std::vector<InputPath> inputs;
  for (const CLI::Option* option : command.get_options()) {
    const std::string type = option->get_type_name();
    const bool is_folder = type == kOutputFolder;
    for (const std::string& value : values_of(*option)) {
      if (is_folder || type == kOutputFile)
        outputs.push_back({option->get_name(), value, is_folder ? OutputPath::Kind::folder : OutputPath::Kind::file});
      else if (option->get_items_expected_max() > 0)
        add_inputs(*option, value, inputs);
    }
  }
  check_outputs(outputs, inputs);
}

}  // namespace

void check_outputs_of(const CLI::App& app) {
  check_command(app);
  for (const CLI::App* command : app.get_subcommands()) check_outputs_of(*command);
}

}  // namespace earshot
