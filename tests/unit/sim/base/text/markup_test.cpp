// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/markup.h"

#include <gtest/gtest.h>

namespace earshot {
namespace {

TEST(Markup, ReservedCharactersAreEscapedAndOthersKept) {
  EXPECT_EQ(escape_markup("<a href=\"x\">1 & 2</a>"), "&lt;a href=&quot;x&quot;&gt;1 &amp; 2&lt;/a&gt;");
  EXPECT_EQ(escape_markup("&amp;"), "&amp;amp;");
  EXPECT_EQ(escape_markup("Gr\xC3\xB6\xC3\x9F\x65 'x'\n"), "Gr\xC3\xB6\xC3\x9F\x65 'x'\n");
  EXPECT_EQ(escape_markup(""), "");
}

}  // namespace
}  // namespace earshot
