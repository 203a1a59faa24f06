// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/json_size.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "sim/base/errors.h"
#include "sim/base/text/json.h"
#include "sim/base/text/json_depth.h"

namespace earshot {
namespace {

struct Counts {
  std::size_t values = 0, texts = 0, lists = 0;
};

void check(const Counts& counts, const std::string& where, const JsonLimits& limits) {
  const auto refuse = [&](const char* items, std::size_t most) {
    throw InputError(where, fmt::format("holds more than {} {}{}", most, items, limits.per_depth > 0 ? " in one entry" : ""),
                     "check that it is the right file");
  };
  if (counts.values > limits.values) refuse("values", limits.values);
  if (counts.texts > limits.texts) refuse("texts", limits.texts);
  if (counts.lists > limits.lists) refuse("lists and maps", limits.lists);
}

}  // namespace

void check_json_size(std::string_view text, const std::string& where, const JsonLimits& limits) {
  Counts outer, inner;  // of what lies less deep than per_depth, and of the part that is read
  std::size_t depth = 0;
  bool quoted = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char letter = text[i];
    if (quoted) {
      if (letter == '\\')
        ++i;  // whatever is escaped does not end the text
      else if (letter == '"')
        quoted = false;
      continue;
    }
    Counts& counts = limits.per_depth > 0 && depth >= limits.per_depth ? inner : outer;
    switch (letter) {
      case '"':
        quoted = true;
        ++counts.texts;
        break;
      case ',':
        ++counts.values;
        break;
      case '[':
      case '{':
        ++depth;
        if (depth == limits.per_depth) {
          inner = {};
          break;
        }
        ++counts.lists;
        break;
      case ']':
      case '}':
        if (depth > 0) --depth;
        break;
      default:
        continue;
    }
    check(counts, where, limits);
  }
}

nlohmann::json parse_sized_json(std::string_view text, const std::string& where, const JsonLimits& limits) {
  check_json_depth(text, where);
  check_json_size(text, where, limits);
  try {
    return parse_json(text);
  } catch (const nlohmann::json::parse_error& error) {
    throw InputError(where, fmt::format("is not JSON: error at byte {}", error.byte), "copy the file again");
  } catch (const nlohmann::json::exception&) {
    throw InputError(where, "has a number that is too large", "copy the file again");
  }
}

}  // namespace earshot
