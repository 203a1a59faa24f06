// SPDX-License-Identifier: Apache-2.0
// Files of every kind with a version that is one too high, through the commands that read them: exit code 2 and one line with that version.
#include <nlohmann/json.hpp>

#include "sim/base/files.h"
#include "sim/base/text/json.h"
#include "tests/support/programs/train_cli.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using Json = nlohmann::json;

class SchemaVersionsCli : public TrainCli {
 protected:
  /// Writes `name` as the file `from` with `key` set.
  std::string raised(const std::string& from, const std::string& name, const std::string& key, int version) const {
    Json json = parse_json(read_file(from));
    json[key] = version;
    write_text(path(name), json_text(json));
    return path(name);
  }
  static testing::Matcher<std::string> names(const std::string& file, int version) {
    return AllOf(HasSubstr(file), HasSubstr("of version " + std::to_string(version) + ", but earshot "), HasSubstr("use a newer earshot"));
  }
};

TEST_F(SchemaVersionsCli, ConfigsOfANewerVersionAreRefused) {
  const std::string config = path("newer.yaml");
  write_text(config, "schema_version: 2\nkey_of_the_future: 1\n" + read_file(path("tiny.yaml")));
  for (const char* command : {"train ", "dataset episodes --config ", "eval greedy --config ", "benchmark "})
    expect_refused(command + config, names("newer.yaml", 2));
  write_text(config, "schema_version: 2\nmesh: a.glb\n");
  expect_refused("scene " + config, names("newer.yaml", 2));
  write_text(config, "schema_version: 1\n" + read_file(path("tiny.yaml")));
  expect_done("dataset episodes --config " + config);
}

TEST_F(SchemaVersionsCli, WhatARunWritesIsRefusedInANewerVersion) {
  const std::string config = path("tiny.yaml");
  expect_done("dataset episodes --config " + config);
  expect_done("eval greedy --config " + config + " --out " + path("result.json"));
  const Json result = parse_json(read_file(path("result.json")));
  const int newer = result.at("earshot_result").get<int>() + 1;
  const std::string file = raised(path("result.json"), "newer.json", "earshot_result", newer);
  expect_refused("leaderboard " + file, names("newer.json", newer));
  expect_refused("verify " + file + " --config " + config, names("newer.json", newer));

  expect_done("train " + config);
  const std::string checkpoint = path("run/checkpoints/" + checkpoints().at(0));
  std::string bytes = read_file(checkpoint);
  bytes[8] = static_cast<char>(bytes[8] + 1);  // the version follows the magic number
  write_text(path("newer.ckpt"), bytes);
  expect_refused("eval " + path("newer.ckpt"), names("newer.ckpt", bytes[8]));

  const std::string episodes = path("newer_episodes.json");
  write_text(episodes, R"({"schema_version": 2, "episodes": [{"a field of the future": 1}]})");
  expect_refused("eval greedy --config " + config + " --set data.eval.file=" + episodes, names("newer_episodes.json", 2));

  write_text(path("materials.json"), R"({"schema_version": 2, "materials": []})");
  expect_refused("materials --lint " + path("materials.json"), names("materials.json", 2));
}

}  // namespace
}  // namespace earshot
