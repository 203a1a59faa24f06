// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <type_traits>
#include <vector>

#include "sim/base/text/config_key.h"

// Types of config values for config_reader.cpp: names, bounds, text.

namespace earshot {

template <class T>
struct ItemOf {
  using Type = T;
};
template <class T>
struct ItemOf<std::vector<T>> {
  using Type = T;
};

template <class T>
inline constexpr bool is_number_type = std::is_arithmetic_v<T> && !std::is_same_v<T, bool>;

template <class T>
constexpr KeyType key_type_of() {
  using Item = typename ItemOf<T>::Type;
  constexpr bool is_list = !std::is_same_v<T, Item>;
  if constexpr (std::is_same_v<T, bool>)
    return KeyType::flag;
  else if constexpr (std::is_same_v<Item, std::string>)
    return is_list ? KeyType::texts : KeyType::text;
  else if constexpr (std::is_integral_v<Item>)
    return is_list ? KeyType::whole_numbers : KeyType::whole_number;
  else if constexpr (std::is_floating_point_v<Item>)
    return is_list ? KeyType::numbers : KeyType::number;
  else
    return KeyType::nested_numbers;
}

/// The declaration without its default and description.
template <class T>
ConfigKey key_of(const std::string& name, const Allowed& allowed) {
  ConfigKey key{.name = name, .type = key_type_of<T>(), .allowed = allowed};
  using Item = typename ItemOf<T>::Type;
  if constexpr (std::is_integral_v<Item> && !std::is_same_v<Item, bool>) {
    key.allowed.low = std::max(allowed.low, static_cast<double>(std::numeric_limits<Item>::min()));
    key.allowed.high = std::min(allowed.high, static_cast<double>(std::numeric_limits<Item>::max()));
  }
  return key;
}

/// Bounds are compared in the type of the value, so that a float of 0.1 is within a bound of 0.1.
template <class T>
bool is_item_allowed(T value, const Allowed& allowed) {
  if constexpr (std::is_floating_point_v<T>)
    if (!std::isfinite(value)) return false;
  if (allowed.other && value == static_cast<T>(*allowed.other)) return true;
  using Compared = std::conditional_t<std::is_floating_point_v<T>, T, double>;
  const auto number = static_cast<Compared>(value), low = static_cast<Compared>(allowed.low), high = static_cast<Compared>(allowed.high);
  if (allowed.is_low_open ? number <= low : number < low) return false;
  if (allowed.is_high_open ? number >= high : number > high) return false;
  if constexpr (std::is_integral_v<T>) return value % static_cast<T>(allowed.multiple) == 0;
  return true;
}

template <class T>
bool is_value_allowed(const T& value, const Allowed& allowed) {
  using Item = typename ItemOf<T>::Type;
  if constexpr (is_number_type<T>) {
    return is_item_allowed(value, allowed);
  } else if constexpr (is_number_type<Item>) {
    if (allowed.count > 0 && value.size() != static_cast<std::size_t>(allowed.count)) return false;
    if (allowed.is_interval && value[0] > value[1]) return false;
    return std::all_of(value.begin(), value.end(), [&](Item item) { return is_item_allowed(item, allowed); });
  } else {
    return true;
  }
}

/// A value as one writes it: floats by their shortest digits.
template <class T>
std::string value_text(const T& value, const Allowed& allowed) {
  if constexpr (is_number_type<T>) {
    if (!allowed.word.empty() && allowed.other && value == static_cast<T>(*allowed.other)) return std::string(allowed.word);
    return fmt::format("{}", value);
  } else if constexpr (std::is_same_v<T, bool>) {
    return value ? "true" : "false";
  } else if constexpr (std::is_same_v<T, std::string>) {
    return value.empty() ? "\"\"" : value;
  } else {
    std::string text;
    for (const auto& item : value) text += (text.empty() ? "" : ", ") + value_text(item, Allowed::any());
    return "[" + text + "]";
  }
}

}  // namespace earshot
