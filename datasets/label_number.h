#pragma once

#include <fmt/format.h>

#include <cstdlib>
#include <nlohmann/json.hpp>
#include <optional>

namespace earshot {

/// A number as labels have it, of six digits: what is measured has no more, and lines stay short.
inline nlohmann::ordered_json rounded(double value) { return std::strtod(fmt::format("{:.6g}", value).c_str(), nullptr); }
/// null where there is none.
inline nlohmann::ordered_json rounded(const std::optional<double>& value) {
  return value ? rounded(*value) : nlohmann::ordered_json(nullptr);
}

}  // namespace earshot
