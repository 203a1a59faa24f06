// SPDX-License-Identifier: Apache-2.0
#include "sim/base/control_characters.h"

#include <gtest/gtest.h>

#include <string>

namespace earshot {
namespace {

std::string utf8(unsigned code) {
  if (code < 0x80) return {static_cast<char>(code)};
  if (code < 0x800) return {static_cast<char>(0xC0 | (code >> 6)), static_cast<char>(0x80 | (code & 0x3F))};
  return {static_cast<char>(0xE0 | (code >> 12)), static_cast<char>(0x80 | ((code >> 6) & 0x3F)), static_cast<char>(0x80 | (code & 0x3F))};
}

// By the code charts: C0 and C1, marks and overrides of direction, separators; nothing else below U+FFFF.
bool is_control_by_the_charts(unsigned code) {
  return code < 0x20 || (code >= 0x7F && code < 0xA0) || code == 0x61C || code == 0x200E || code == 0x200F ||
         (code >= 0x2028 && code <= 0x202E) || (code >= 0x2066 && code <= 0x2069);
}

TEST(ControlCharacters, AreThoseOfTheCharts) {
  for (unsigned code = 1; code < 0xFFFF; ++code) {
    if (code >= 0xD800 && code < 0xE000) continue;  // surrogates are not characters
    const std::string text = "a" + utf8(code) + "b";
    EXPECT_EQ(has_control_character(text), is_control_by_the_charts(code)) << code;
    EXPECT_EQ(printable(text), is_control_by_the_charts(code) ? "a b" : text) << code;
  }
}

TEST(ControlCharacters, BytesThatAreNoTextAreFoundToo) {
  EXPECT_TRUE(
      has_control_character("\x9b"
                            "31m"));  // what begins an escape sequence in Latin-1
  EXPECT_TRUE(has_control_character("\xe2\x9b\x1b[2J"));
  EXPECT_FALSE(has_control_character("\xe2"));
  EXPECT_FALSE(has_control_character(""));
  EXPECT_EQ(printable("\x1b[2J\x9b"), " [2J ");
}

}  // namespace
}  // namespace earshot
