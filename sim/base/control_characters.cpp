// SPDX-License-Identifier: Apache-2.0
#include "sim/base/control_characters.h"

#include <algorithm>
#include <cstddef>

namespace earshot {
namespace {

/// Bytes of the character that starts at the head of `text`, as its first byte says and as continue it.
std::size_t length_of(std::string_view text) {
  const auto first = static_cast<unsigned char>(text[0]);
  const std::size_t told = first >= 0xF0 ? 4 : first >= 0xE0 ? 3 : first >= 0xC0 ? 2 : 1;
  std::size_t length = 1;
  while (length < std::min(told, text.size()) && (static_cast<unsigned char>(text[length]) & 0xC0u) == 0x80u) ++length;
  return length;
}

/// character: the bytes of one.
bool is_control(std::string_view character) {
  const auto at = [&](std::size_t i) { return static_cast<unsigned>(static_cast<unsigned char>(character[i])); };
  if (character.size() == 1) return at(0) < 0x20 || at(0) == 0x7F || (at(0) >= 0x80 && at(0) < 0xA0);
  if (character.size() == 2) return (at(0) == 0xC2 && at(1) < 0xA0) || (at(0) == 0xD8 && at(1) == 0x9C);  // U+0080 to U+009F, U+061C
  if (character.size() != 3 || at(0) != 0xE2) return false;
  if (at(1) == 0x80) return at(2) == 0x8E || at(2) == 0x8F || (at(2) >= 0xA8 && at(2) <= 0xAE);  // U+200E, 200F, 2028 to 202E
  return at(1) == 0x81 && at(2) >= 0xA6 && at(2) <= 0xA9;                                        // U+2066 to 2069
}

}  // namespace

bool has_control_character(std::string_view text) {
  for (; !text.empty(); text.remove_prefix(length_of(text)))
    if (is_control(text.substr(0, length_of(text)))) return true;
  return false;
}

std::string printable(std::string_view text) {
  std::string shown;
  for (; !text.empty(); text.remove_prefix(length_of(text))) {
    const std::string_view character = text.substr(0, length_of(text));
    shown += is_control(character) ? std::string_view(" ") : character;
  }
  return shown;
}

}  // namespace earshot
