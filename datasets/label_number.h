#pragma once

#include <fmt/format.h>

#include <cstdlib>
#include <nlohmann/json.hpp>

namespace earshot {

/// A number as labels have it: six digits.
inline nlohmann::ordered_json rounded(double value) { return std::strtod(fmt::format("{:.6g}", value).c_str(), nullptr); }

}  // namespace earshot
