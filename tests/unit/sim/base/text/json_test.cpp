// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/json.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace earshot {
namespace {

using nlohmann::json;
using nlohmann::ordered_json;

TEST(Json, IsReadAsItWasWritten) {
  const json value = {{"b", {1, 2.5, nullptr}}, {"a", "é"}, {"deep", {{"c", true}}}};
  for (const int indent : {-1, 0, 1, 2}) EXPECT_EQ(parse_json(json_text(value, indent)), value) << indent;
  EXPECT_EQ(json_text(value), R"({"a":"é","b":[1,2.5,null],"deep":{"c":true}})");
  EXPECT_EQ(json_text(json{{"a", 1}}, 1), "{\n \"a\": 1\n}");
}

TEST(Json, OrderedKeepsTheOrderOfItsText) {
  const std::string text = R"({"b":1,"a":{"d":2,"c":3}})";
  EXPECT_EQ(json_text(parse_ordered_json(text)), text);
  EXPECT_EQ(json_text(parse_json(text)), R"({"a":{"c":3,"d":2},"b":1})");
}

TEST(Json, NoJsonIsAnErrorOrDiscarded) {
  for (const char* text : {"", "{", "[1,]", "{} {}", "nan"}) {
    EXPECT_THROW(static_cast<void>(parse_json(text)), json::parse_error) << text;
    EXPECT_THROW(static_cast<void>(parse_ordered_json(text)), json::parse_error) << text;
    EXPECT_TRUE(parse_json_or_discard(text).is_discarded()) << text;
  }
  EXPECT_EQ(parse_json_or_discard("[1]"), json({1}));
}

/// To nlohmann's parser a text ends at its first NUL.
TEST(Json, TextBehindANulIsAnErrorAndPaddingIsNot) {
  const std::string whole = R"({"a":[1,"b"],"c":{"d":2.5}})";
  for (std::size_t at = 0; at <= whole.size(); ++at) {
    std::string text = whole;
    text.insert(at, 1, '\0');
    if (at == whole.size()) text += R"({"e": ")";
    EXPECT_THROW(static_cast<void>(parse_json(text)), json::parse_error) << at;
    EXPECT_THROW(static_cast<void>(parse_ordered_json(text)), json::parse_error) << at;
    EXPECT_TRUE(parse_json_or_discard(text).is_discarded()) << at;
  }
  EXPECT_EQ(parse_json(whole + std::string(3, '\0')), parse_json(whole));
  EXPECT_EQ(parse_json_or_discard(whole + std::string(3, '\0')), parse_json(whole));
}

TEST(Json, HundredsOfLevelsAreNoJson) {
  const auto nested = [](std::size_t levels) { return std::string(levels, '[') + std::string(levels, ']'); };
  EXPECT_EQ(json_text(parse_json(nested(256))), nested(256));
  EXPECT_EQ(json_text(parse_ordered_json(nested(256))), nested(256));
  EXPECT_FALSE(parse_json_or_discard(nested(256)).is_discarded());
  for (const std::size_t levels : {257u, 1'000'000u}) {
    EXPECT_THROW(static_cast<void>(parse_json(nested(levels))), json::parse_error);
    EXPECT_THROW(static_cast<void>(parse_ordered_json(nested(levels))), json::parse_error);
    EXPECT_TRUE(parse_json_or_discard(nested(levels)).is_discarded());
  }
}

TEST(Json, BytesThatAreNoTextAreReplacedWhereAsked) {
  const std::string bytes =
      "a\xff\xfe"
      "b";
  EXPECT_THROW(static_cast<void>(json_text(json(bytes))), json::type_error);
  EXPECT_THROW(static_cast<void>(json_text(ordered_json(bytes))), json::type_error);
  EXPECT_EQ(json_text_of_any_bytes(json(bytes)), "\"a\uFFFD\uFFFDb\"");
  EXPECT_EQ(json_text_of_any_bytes(ordered_json{{"k", bytes}}, 1), "{\n \"k\": \"a\uFFFD\uFFFDb\"\n}");
}

}  // namespace
}  // namespace earshot
