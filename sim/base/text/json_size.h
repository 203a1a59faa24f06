// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

namespace earshot {

/// Limits on the size of a JSON text: parsed, it takes up to fifty times the bytes of the text.
struct JsonLimits {
  std::size_t values;  ///< items of lists and maps
  std::size_t texts;   ///< in quotes, keys included
  std::size_t lists;   ///< and maps
  /// 0: of the whole text.  Else of each part of the text at least so many levels deep, and of what lies between such parts.
  std::size_t per_depth = 0;
};

/// Throws InputError naming `where` if the text holds more.  It need not be valid.  One pass, 0.5 GB/s.
void check_json_size(std::string_view text, const std::string& where, const JsonLimits& limits);

/// The JSON of a file that comes from others.  Throws InputError naming `where`: check_json_depth, check_json_size, no JSON, a number
/// beyond doubles.
nlohmann::json parse_sized_json(std::string_view text, const std::string& where, const JsonLimits& limits);

}  // namespace earshot
