// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>

#include <cstdlib>
#include <nlohmann/json.hpp>
#include <optional>

namespace earshot {

/// A number in a label, with six digits: measurements have no more, and lines stay short.  Times of sounds have more digits.
inline nlohmann::ordered_json rounded(double value, int digits = 6) {
  return std::strtod(fmt::format("{:.{}g}", value, digits).c_str(), nullptr);
}
/// null without a value.
inline nlohmann::ordered_json rounded(const std::optional<double>& value) {
  return value ? rounded(*value) : nlohmann::ordered_json(nullptr);
}

}  // namespace earshot
