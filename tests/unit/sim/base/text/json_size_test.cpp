// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/json_size.h"

#include <gtest/gtest.h>

#include <string>

#include "sim/base/errors.h"

namespace earshot {
namespace {

bool refused(const std::string& text, const JsonLimits& limits) {
  try {
    check_json_size(text, "file", limits);
  } catch (const InputError&) {
    return true;
  }
  return false;
}

std::string repeated(const std::string& text, int times) {
  std::string all;
  for (int i = 0; i < times; ++i) all += text;
  return all;
}

TEST(JsonSize, CountsValuesTextsAndLists) {
  const JsonLimits limits{.values = 9, .texts = 5, .lists = 4};
  EXPECT_FALSE(refused("[" + repeated("1,", 9) + "1]", limits));
  EXPECT_TRUE(refused("[" + repeated("1,", 10) + "1]", limits));
  EXPECT_FALSE(refused("[" + repeated("\"a\",", 5) + "1]", limits));
  EXPECT_TRUE(refused("[" + repeated("\"a\",", 6) + "1]", limits));
  EXPECT_FALSE(refused("[" + repeated("[],", 3) + "1]", limits));
  EXPECT_TRUE(refused("[" + repeated("{},", 4) + "1]", limits));
  EXPECT_FALSE(refused(R"(["[[[[[[,,,,,,,,,,,,,\"[[[["])", limits));  // within a text they are letters
}

TEST(JsonSize, CountsByEntry) {
  const JsonLimits limits{.values = 9, .texts = 5, .lists = 4, .per_depth = 3};
  const std::string entry = "{\"a\": [1,1,1], \"b\": [1,1,1]}";
  EXPECT_FALSE(refused("{\"episodes\": [" + repeated(entry + ",", 9) + entry + "]}", limits));
  EXPECT_TRUE(refused("{\"episodes\": [" + repeated(entry + ",", 10) + entry + "]}", limits));  // entries are values themselves
  EXPECT_TRUE(refused("{\"episodes\": [{\"a\": [" + repeated("1,", 10) + "1]}]}", limits));
  EXPECT_TRUE(refused("{\"other\": [" + repeated("1,", 10) + "1]}", limits));
}

}  // namespace
}  // namespace earshot
