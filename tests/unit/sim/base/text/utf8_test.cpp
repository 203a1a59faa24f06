// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/utf8.h"

#include <gtest/gtest.h>

#include <string>

namespace earshot {
namespace {

// The first and last sequences of each length, and what RFC 3629 section 3 rules out beside them.
TEST(Utf8, SequencesAreThoseOfTheStandard) {
  for (const char* text : {"", "a", "\x7F", "\xC2\x80", "\xDF\xBF", "\xE0\xA0\x80", "\xED\x9F\xBF", "\xEE\x80\x80", "\xEF\xBF\xBF",
                           "\xF0\x90\x80\x80", "\xF4\x8F\xBF\xBF"})
    EXPECT_TRUE(is_utf8(text)) << text;
  for (const char* text : {"\x80", "\xC0\x80", "\xC1\xBF", "\xC2", "\xC2g", "\xE0\x9F\xBF", "\xED\xA0\x80", "\xE2\x82", "\xF0\x8F\xBF\xBF",
                           "\xF4\x90\x80\x80", "\xF5\x80\x80\x80", "caf\xE9", "\xFF"})
    EXPECT_FALSE(is_utf8(text)) << text;
  EXPECT_FALSE(is_utf8(std::string("a\0b", 3)));
}

}  // namespace
}  // namespace earshot
