// SPDX-License-Identifier: Apache-2.0
// Files of newer versions are refused with one line that names the version; files without a version are of version 1.
#include "sim/base/text/schema_version.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"
#include "sim/base/version.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;

std::string refusal(const std::function<void()>& body) {
  try {
    body();
  } catch (const InputError& error) {
    return error.what();
  }
  return {};
}

TEST(SchemaVersion, OfNewerFilesIsNamed) {
  EXPECT_EQ(refusal([] { check_schema_version("a.json", "a result", 1, {}); }), "");
  EXPECT_THAT(refusal([] { check_schema_version("a.json", "a result", 2, {}); }),
              AllOf(HasSubstr("a.json"), HasSubstr(std::string("is a result of version 2, but earshot ") + kVersion + " reads version 1"),
                    HasSubstr("use a newer earshot")));
  EXPECT_THAT(refusal([] { check_schema_version("a.json", "a result", 4, {.oldest = 1, .newest = 3}); }),
              HasSubstr("reads versions 1 to 3"));
  EXPECT_THAT(refusal([] { check_schema_version("a.json", "a result", 1, {.oldest = 2, .newest = 2}); }),
              HasSubstr("use the version of earshot that wrote it"));
  for (const std::int64_t version : {std::int64_t{0}, std::int64_t{-1}, std::int64_t{1} << 40})
    EXPECT_NE(refusal([&] { check_schema_version("a.json", "a result", version, {}); }), "") << version;
}

TEST(SchemaVersion, OfJsonIsAWholeNumberOrAbsent) {
  using Json = nlohmann::json;
  const auto check = [](const Json& document) { check_schema_version(document, "schema_version", "a.json", "a result", {}); };
  EXPECT_EQ(refusal([&] { check({{"other", 5}}); }), "");
  EXPECT_NE(refusal([&] { check({{"schema_version", 2}}); }), "");
  for (const Json& version : {Json(1.5), Json("1"), Json(nullptr), Json::array({1})})
    EXPECT_THROW(check({{"schema_version", version}}), Json::exception) << version;
}

TEST(SchemaVersion, OfYamlIsCheckedBeforeAnyKeyAndTakenOut) {
  const auto read = [](const std::string& yaml, const std::vector<std::string>& overrides = {}) {
    return ConfigReader::from_text(yaml, "run.yaml", overrides);
  };
  ConfigReader reader = read("schema_version: 1\nseed: 3\n");
  int seed = 0;
  reader.read("seed", seed, "Seed of the test.");
  reader.finish();
  EXPECT_EQ(seed, 3);
  EXPECT_THAT(refusal([&] { read("schema_version: 2\nkey_of_the_future: 3\n"); }),
              AllOf(HasSubstr("run.yaml"), HasSubstr("a config of version 2"), HasSubstr("use a newer earshot")));
  EXPECT_THAT(refusal([&] { read("seed: 3\n", {"schema_version=7"}); }), HasSubstr("of version 7"));
  EXPECT_THAT(refusal([&] { read("schema_version: two\n"); }), HasSubstr("schema_version is two; use 1"));
}

}  // namespace
}  // namespace earshot
