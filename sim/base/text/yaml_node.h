// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace earshot {

/// A value of a YAML text before its type is resolved: a scalar, a list or a map.
struct YamlNode {
  enum class Kind { scalar, list, map };
  struct Key {
    std::string text;
    std::uint32_t line = 0;
    bool is_plain = true;
  };

  Kind kind = Kind::scalar;
  bool is_plain = true;        ///< a scalar without quotes
  std::uint32_t line = 0;      ///< in which it begins, from 1; 0: of no file
  std::string text = {};       ///< of a scalar, without quotes and escapes; empty where a value is left out
  std::vector<Key> keys = {};  ///< of a map: one for each of `items`, in the order of the text
  std::vector<YamlNode> items = {};

  static YamlNode empty_map() { return {.kind = Kind::map}; }
  [[nodiscard]] bool is_scalar() const { return kind == Kind::scalar; }
  [[nodiscard]] bool is_list() const { return kind == Kind::list; }
  [[nodiscard]] bool is_map() const { return kind == Kind::map; }
  /// A value that is left out, `~` or `null`.
  [[nodiscard]] bool is_null() const {
    return is_scalar() && is_plain && (text.empty() || text == "~" || text == "null" || text == "Null" || text == "NULL");
  }
  /// The value under `key` of a map; nullptr if it is absent, or this is no map.
  [[nodiscard]] const YamlNode* find(std::string_view key) const {
    for (std::size_t i = 0; i < keys.size(); ++i)
      if (keys[i].text == key) return &items[i];
    return nullptr;
  }
  [[nodiscard]] YamlNode* find(std::string_view key) { return const_cast<YamlNode*>(std::as_const(*this).find(key)); }
};

}  // namespace earshot
