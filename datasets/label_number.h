// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>

#include <cstdlib>
#include <nlohmann/json.hpp>
#include <optional>

namespace earshot {

/// A number as labels have it, of six digits: what is measured has no more, and lines stay short.  What places sounds in time has more.
inline nlohmann::ordered_json rounded(double value, int digits = 6) {
  return std::strtod(fmt::format("{:.{}g}", value, digits).c_str(), nullptr);
}
/// null where there is none.
inline nlohmann::ordered_json rounded(const std::optional<double>& value) {
  return value ? rounded(*value) : nlohmann::ordered_json(nullptr);
}

}  // namespace earshot
