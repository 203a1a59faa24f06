// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <string>
#include <string_view>

#include "sim/base/errors.h"

/// Scene specs of generated buildings: `KIND:SEED[,key=value...]`.
namespace earshot {

/// Walls, doors and furniture stand on a lattice of this width.
inline constexpr int kLatticeMm = 50;

inline constexpr std::string_view kHouseUsage = "write house:SEED[,rooms=3][,area_m2=36][,height_m=2.7][,furnished=false][,detail_m=0.12]";
inline constexpr std::string_view kFloorUsage =
    "write floor:SEED[,width_m=25][,length_m=57][,height_m=2.7][,furnished=false][,detail_m=0.12]";
inline std::string_view plan_usage(std::string_view kind) { return kind == "floor" ? kFloorUsage : kHouseUsage; }

template <class Number>
Number parse_plan_number(std::string_view kind, std::string_view key, std::string_view text) {
  Number value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size())
    throw InputError(std::string(kind) + ":" + std::string(key), "'" + std::string(text) + "' is not a number in range", plan_usage(kind));
  return value;
}

/// Sets what every generated building has: its height, its detail, its furniture.  False for other keys.
template <class Config>
bool set_building(std::string_view kind, std::string_view key, std::string_view value, Config& config) {
  if (key == "height_m") return config.height_m = parse_plan_number<float>(kind, key, value), true;
  if (key == "detail_m") return config.detail_m = parse_plan_number<float>(kind, key, value), true;
  if (key == "furnished" && (value == "true" || value == "false")) return config.furnished = value == "true", true;
  return false;
}

/// Reads the seed, then hands each key and its value to `set`, which returns false for what it does not know.  Throws InputError.
template <class Set>
void read_plan_settings(std::string_view kind, std::string_view text, std::uint64_t& seed, Set set) {
  for (bool first = true; first || !text.empty(); first = false) {
    const std::size_t comma = std::min(text.find(','), text.size());
    const std::string_view item = text.substr(0, comma);
    text.remove_prefix(std::min(comma + 1, text.size()));
    if (first) {
      seed = parse_plan_number<std::uint64_t>(kind, "SEED", item);
      continue;
    }
    const std::size_t equals = std::min(item.find('='), item.size());
    if (!set(item.substr(0, equals), item.substr(std::min(equals + 1, item.size()))))
      throw InputError(std::string(kind) + ":" + std::string(item), "is not a known setting", plan_usage(kind));
  }
}

}  // namespace earshot
