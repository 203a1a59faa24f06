// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/json.h"

#include <nlohmann/json.hpp>

#include "sim/base/text/json_depth.h"

namespace earshot {
namespace {

template <class Json>
Json parse(std::string_view text) {
  if (json_depth(text) > kMaxJsonDepth) throw Json::parse_error::create(101, 0, "nests lists and maps hundreds of levels deep", nullptr);
  if (const std::size_t nul = nul_within_json(text); nul != text.npos)
    throw Json::parse_error::create(101, nul + 1, "a NUL byte within the text", nullptr);
  return Json::parse(text);
}

}  // namespace

nlohmann::json parse_json(std::string_view text) { return parse<nlohmann::json>(text); }
nlohmann::ordered_json parse_ordered_json(std::string_view text) { return parse<nlohmann::ordered_json>(text); }

nlohmann::json parse_json_or_discard(std::string_view text) {
  if (json_depth(text) > kMaxJsonDepth || nul_within_json(text) != text.npos) return nlohmann::json::value_t::discarded;
  return nlohmann::json::parse(text, nullptr, false);
}

std::string json_text(const nlohmann::json& json, int indent) { return json.dump(indent); }
std::string json_text(const nlohmann::ordered_json& json, int indent) { return json.dump(indent); }

std::string json_text_of_any_bytes(const nlohmann::json& json, int indent) {
  return json.dump(indent, ' ', false, nlohmann::json::error_handler_t::replace);
}
std::string json_text_of_any_bytes(const nlohmann::ordered_json& json, int indent) {
  return json.dump(indent, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

}  // namespace earshot
