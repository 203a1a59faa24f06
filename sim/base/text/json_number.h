// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <concepts>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>

namespace earshot {

/// A whole number within the range of T.  json::get casts any number, 1e300, 2.5 and -1 too, which is undefined or another number.
/// Json: nlohmann::json, whose header the caller includes.  Throws json::exception that names the key.
template <std::integral T, class Json>
T whole_number(const Json& object, const char* key) {
  const Json& value = object.at(key);
  const bool fits = value.is_number_unsigned()  ? std::in_range<T>(value.template get<std::uint64_t>())
                    : value.is_number_integer() ? std::in_range<T>(value.template get<std::int64_t>())
                                                : false;
  if (!fits) throw Json::other_error::create(600, std::string("'") + key + "' is not a whole number in range", &value);
  return value.template get<T>();
}

/// A number that is finite as a T.  Throws json::exception that names the key.
template <std::floating_point T, class Json>
T finite_number(const Json& object, const char* key) {
  const Json& value = object.at(key);
  const double number = value.is_number() ? value.template get<double>() : std::numeric_limits<double>::infinity();
  if (!(std::abs(number) <= static_cast<double>(std::numeric_limits<T>::max())))
    throw Json::other_error::create(600, std::string("'") + key + "' is not a finite number", &value);
  return static_cast<T>(number);
}

}  // namespace earshot
