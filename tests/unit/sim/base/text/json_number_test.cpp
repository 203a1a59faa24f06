// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/json_number.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "sim/base/text/json.h"

namespace earshot {
namespace {

using nlohmann::json;

TEST(JsonNumber, WholeNumbersMustFit) {
  const json object =
      parse_json(R"({"a": 127, "b": 128, "c": -1, "d": 2.5, "e": 1e300, "f": "1", "g": 18446744073709551615, "h": true, "i": -129})");
  EXPECT_EQ(whole_number<std::int8_t>(object, "a"), 127);
  EXPECT_EQ(whole_number<int>(object, "c"), -1);
  EXPECT_EQ(whole_number<std::uint64_t>(object, "g"), std::numeric_limits<std::uint64_t>::max());
  for (const char* key : {"b", "d", "e", "f", "g", "h", "i", "none"})
    EXPECT_THROW(whole_number<std::int8_t>(object, key), json::exception) << key;
  EXPECT_THROW(whole_number<std::uint64_t>(object, "c"), json::exception) << "not 2^64 - 1";
  EXPECT_THROW(whole_number<std::int64_t>(object, "g"), json::exception) << "not -1";
}

TEST(JsonNumber, NumbersMustBeFiniteInTheirType) {
  const json object = parse_json(R"({"a": 1.5, "b": 1e300, "c": -3, "d": null, "e": "1"})");
  EXPECT_EQ(finite_number<float>(object, "a"), 1.5f);
  EXPECT_EQ(finite_number<double>(object, "b"), 1e300);
  EXPECT_EQ(finite_number<float>(object, "c"), -3.f);
  for (const char* key : {"b", "d", "e", "none"}) EXPECT_THROW(finite_number<float>(object, key), json::exception) << key;
}

TEST(JsonNumber, TheMessageNamesTheKey) {
  try {
    whole_number<int>(parse_json(R"({"seed": 1e300})"), "seed");
    FAIL();
  } catch (const json::exception& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("'seed' is not a whole number in range"));
  }
}

}  // namespace
}  // namespace earshot
