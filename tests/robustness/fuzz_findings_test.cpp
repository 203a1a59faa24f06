// SPDX-License-Identifier: Apache-2.0
// What the fuzz targets found, or what was found while they were written: the smallest input of each, as it stood.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "envs/batch/env_state.h"
#include "envs/batch/quarantine.h"
#include "envs/episodes/episode_set.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/config_reader.h"
#include "sim/scene/materials/materials.h"
#include "sim/scene/readers/mesh_import.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

template <class Action>
std::string refusal(Action action) {
  return message_of<InputError>(action);
}

// A million brackets: a recursive walk of this tree (Json::dump for a message, for a checksum) is a million calls deep.
TEST(X_DeepTexts, JsonIsRefusedBeforeItIsParsed) {
  const std::string brackets(1'000'000, '[');
  const std::string closed = brackets + std::string(brackets.size(), ']');
  const TempFolder folder;
  EXPECT_THAT(refusal([&] { MaterialDatabase::from_json(R"({"materials":[{"name":"a","absorption":[1,)" + closed + "]}]}", "m.json"); }),
              HasSubstr("levels"));
  EXPECT_THAT(refusal([&] { decode_env_state(R"({"earshot_env_state":2,"checksum":"0","body":)" + closed + "}"); }), HasSubstr("levels"));
  EXPECT_THAT(refusal([&] { decode_quarantine_record(R"({"earshot_quarantine":1,"set":)" + closed + "}", "q.json"); }),
              HasSubstr("levels"));
  EXPECT_THAT(refusal([&] { parse_episode_set(R"({"episodes":[{"episode_id":)" + closed + "}]}", "set.json"); }), HasSubstr("levels"));
  EXPECT_THAT(refusal([&] { import_mesh(folder.write("deep.gltf", R"({"asset":{"version":"2.0"},"extras":)" + closed + "}")); }),
              HasSubstr("levels"));
  EXPECT_NE(refusal([&] { parse_episode_set(brackets, "set.json"); }), "");
}

TEST(X_DeepTexts, YamlIsRefused) {
  for (const char* letter : {"[", "{", "- "}) {
    std::string deep = "key: ";
    if (letter[0] == '-') deep.clear();
    for (int i = 0; i < 20'000; ++i) deep += letter;
    EXPECT_NE(refusal([&] { ConfigReader::from_text(deep, "deep.yaml"); }), "") << letter;
  }
}

// Names from files went into messages as they were: several lines on stderr, or what moves the cursor of a terminal.
TEST(X_MessagesOfOneLine, WhateverIsInAName) {
  const std::string message = InputError("a\nb.obj", "material '\x1b[2J\r\n\t' is unknown", "no\x7fne").what();
  EXPECT_EQ(message, "a b.obj: material ' [2J   ' is unknown; no ne");
  EXPECT_LT(std::string_view(InputError(std::string(100'000, 'x'), "", "").what()).size(), 4100u);
  ConfigReader reader = ConfigReader::from_text("\"two\\nlines\": 1", "run.yaml");
  EXPECT_THAT(refusal([&] { reader.finish(); }), AllOf(HasSubstr("two lines"), Not(HasSubstr("\n"))));
}

// json::get<int>() casts any number that is there: 1e300 is undefined, -1 becomes 2^64 - 1, 2.5 becomes 2.
TEST(X_NumbersThatDoNotFit, AreRefusedByTheirKey) {
  const auto state = [](const std::string& seed, const std::string& first_env) {
    const std::string body = R"({"envs":[],"first_env":)" + first_env + R"(,"seed":)" + seed +
                             R"(,"set_hash":"00000000000000ff","started":true,"total_envs":2})";
    return R"({"earshot_env_state":2,"checksum":")" + hex64(hash64(body)) + R"(","body":)" + body + "}";
  };
  EXPECT_EQ(decode_env_state(state("7", "0")).seed, 7u);
  for (const char* number : {"-1", "2.5", "\"7\""})
    EXPECT_THAT(refusal([&] { decode_env_state(state(number, "0")); }), HasSubstr("'seed'")) << number;
  EXPECT_THAT(refusal([&] { decode_env_state(state("7", "3000000000")); }), HasSubstr("'first_env'"));
  for (const char* number : {"1e300", "-1", "2.5"})
    EXPECT_THAT(refusal([&] {
                  decode_quarantine_record(
                      R"({"earshot_quarantine":1,"reason":"rir","detail":"","engine":"","seed":)" + std::string(number) + "}", "q.json");
                }),
                HasSubstr("'seed'"))
        << number;
}

}  // namespace
}  // namespace earshot
