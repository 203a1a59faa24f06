// SPDX-License-Identifier: Apache-2.0
#include "apps/options/decimal_options.h"

#include <optional>
#include <string>

#include "sim/base/text/config_number.h"

namespace earshot {
namespace {

// CLI11 alone takes 010 for eight, and refuses 3e6 for a whole number.  Validators run before the number is parsed.
std::string read_whole(std::string& text) {
  const std::optional<std::string> digits = whole_digits(text);
  if (!digits) return "'" + text + "' is no whole decimal number";
  text = *digits;
  return "";
}

std::string read_number(std::string& text) {
  if (!parse_decimal<double>(text)) return "'" + text + "' is no decimal number";
  if (text.front() == '+') text.erase(0, 1);
  return "";
}

}  // namespace

void read_decimal_numbers(CLI::App& app) {
  for (CLI::Option* option : app.get_options([](CLI::Option*) { return true; })) {
    const std::string type = option->get_type_name();
    if (type.starts_with("INT") || type.starts_with("UINT")) option->transform(CLI::Validator(read_whole, ""));
    if (type.starts_with("FLOAT")) option->transform(CLI::Validator(read_number, ""));
  }
  for (CLI::App* command : app.get_subcommands([](CLI::App*) { return true; })) read_decimal_numbers(*command);
}

}  // namespace earshot
