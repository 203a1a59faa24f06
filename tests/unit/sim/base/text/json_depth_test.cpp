// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/json_depth.h"

#include <gtest/gtest.h>

#include "sim/base/errors.h"

namespace earshot {
namespace {

TEST(JsonDepth, CountsLevels) {
  EXPECT_EQ(json_depth(""), 0u);
  EXPECT_EQ(json_depth("3"), 0u);
  EXPECT_EQ(json_depth("[]"), 1u);
  EXPECT_EQ(json_depth(R"({"a": [1, {"b": []}], "c": [[]]})"), 4u);
  EXPECT_EQ(json_depth("[][][]"), 1u);
  EXPECT_EQ(json_depth("]]}}["), 1u);
}

TEST(JsonDepth, TextsDoNotCount) {
  EXPECT_EQ(json_depth(R"(["[[[[", "\"[[", "\\", [1]])"), 2u);
  EXPECT_EQ(json_depth(R"("unfinished [[[)"), 0u);
  EXPECT_EQ(json_depth("\"\\"), 0u) << "a text that ends behind its escape";
}

TEST(JsonDepth, HundredsAreRefused) {
  const auto nested = [](std::size_t levels) { return std::string(levels, '[') + std::string(levels, ']'); };
  EXPECT_NO_THROW(check_json_depth(nested(256), "a.json"));
  EXPECT_THROW(check_json_depth(nested(257), "a.json"), InputError);
}

}  // namespace
}  // namespace earshot
