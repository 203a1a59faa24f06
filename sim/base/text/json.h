// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

namespace earshot {

// Reading and writing of JSON, compiled once: each source that calls nlohmann's own parse() or dump() compiles a parser or a
// writer, three seconds and one and a half.

/// Throws nlohmann::json::parse_error where the text is no JSON, has a NUL byte within (nul_within_json), or nests deeper than
/// kMaxJsonDepth (json_depth.h): whatever walks the result calls itself once per level.
[[nodiscard]] nlohmann::json parse_json(std::string_view text);
[[nodiscard]] nlohmann::ordered_json parse_ordered_json(std::string_view text);
/// Discarded (is_discarded()) there.
[[nodiscard]] nlohmann::json parse_json_or_discard(std::string_view text);

/// On one line, or with this many blanks per level.  Throws nlohmann::json::type_error where a string is not UTF-8.
[[nodiscard]] std::string json_text(const nlohmann::json& json, int indent = -1);
[[nodiscard]] std::string json_text(const nlohmann::ordered_json& json, int indent = -1);
/// With U+FFFD for bytes that are not UTF-8.
[[nodiscard]] std::string json_text_of_any_bytes(const nlohmann::json& json, int indent = -1);
[[nodiscard]] std::string json_text_of_any_bytes(const nlohmann::ordered_json& json, int indent = -1);

}  // namespace earshot
