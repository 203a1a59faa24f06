// SPDX-License-Identifier: Apache-2.0
#include "apps/options/number_range.h"

#include <charconv>
#include <cmath>

#include "sim/base/errors.h"

namespace earshot {
namespace {

float parse_number(const std::string& part, const std::string& text, const std::string& option) {
  float value = 0;
  const auto [end, error] = std::from_chars(part.data(), part.data() + part.size(), value);
  if (error != std::errc() || end != part.data() + part.size() || !std::isfinite(value))
    throw InputError(option + " " + text, "is not a range LOW,HIGH", "write two numbers, for example " + option + " 5,20");
  return value;
}

}  // namespace

std::vector<float> parse_range(const std::string& text, const std::string& option) {
  const std::size_t comma = text.find(',');
  const float low = parse_number(text.substr(0, comma), text, option);
  return {low, comma == std::string::npos ? low : parse_number(text.substr(comma + 1), text, option)};
}

}  // namespace earshot
