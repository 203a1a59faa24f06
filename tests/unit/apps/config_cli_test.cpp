// SPDX-License-Identifier: Apache-2.0
// `earshot config`, and the messages of readers as a user meets them.

#include <nlohmann/json.hpp>
#include <sstream>

#include "sim/base/text/json.h"
#include "tests/support/programs/cli.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::StartsWith;

TEST_F(Cli, ConfigPrintsEveryKeyWithinTheWidth) {
  const CliOutcome all = earshot("config");
  EXPECT_EQ(all.exit_code, 0) << all.errors;
  EXPECT_THAT(all.output, AllOf(StartsWith("run config\n=========="), HasSubstr("\nppo: "), HasSubstr("\nenv.acoustics: "),
                                HasSubstr("learning_rate"), HasSubstr("\nmicrophone array\n"), HasSubstr("\nacoustic settings\n")));
  std::istringstream lines(all.output);
  for (std::string line; std::getline(lines, line);) EXPECT_LE(line.size(), 100u) << line;
}

TEST_F(Cli, ConfigPrintsOneKeyOrASection) {
  const CliOutcome key = earshot("config env.acoustics.rays");
  EXPECT_EQ(key.exit_code, 0) << key.errors;
  EXPECT_THAT(key.output, AllOf(StartsWith("env.acoustics.rays\n"), HasSubstr("type     whole number\n"), HasSubstr("default  64\n"),
                                HasSubstr("range    0 to 2,147,483,647\n"), HasSubstr("in: run config, benchmark")));
  const CliOutcome section = earshot("config ppo");
  EXPECT_EQ(section.exit_code, 0) << section.errors;
  EXPECT_THAT(section.output, AllOf(StartsWith("ppo: "), HasSubstr("clip"), HasSubstr("lambda"), HasSubstr("above 0 and below 1")));
  EXPECT_THAT(earshot("config scene").output, AllOf(StartsWith("scene\n====="), HasSubstr("ceiling_m")));
  EXPECT_THAT(earshot("config env.observation.cameras.back.yaw_deg").output, HasSubstr("degrees"));
}

TEST_F(Cli, ConfigRefusesWhatIsNoKey) {
  expect_bad_input("config ppo.clp", "did you mean 'ppo.clip'?");
  expect_bad_input("config learning_rate", "did you mean 'ppo.learning_rate'?");
  expect_bad_input("config zzzzzzzzzzzz", "'earshot config' prints all keys");
  expect_bad_input("config ppo --markdown", "--markdown");
}

TEST_F(Cli, ConfigWritesThePageAndJson) {
  const CliOutcome page = earshot("config --markdown --json " + file("keys.json"));
  EXPECT_EQ(page.exit_code, 0) << page.errors;
  EXPECT_THAT(page.output, AllOf(StartsWith("# Config keys\n"), HasSubstr("$ earshot config ppo.clip\n"), HasSubstr("## Run config"),
                                 HasSubstr("| key | type | default | unit | range | description |"), HasSubstr("| `learning_rate` |")));
  const auto all = parse_json(read("keys.json"));
  EXPECT_EQ(all.at("schema_version"), 1);
  EXPECT_GT(all.at("kinds").at(0).at("keys").size(), 150u);
  ASSERT_EQ(earshot("config ppo.clip --json " + file("clip.json")).exit_code, 0);
  const auto clip = parse_json(read("clip.json")).at("kinds").at(0).at("keys").at(0);
  EXPECT_EQ(clip.at("key"), "ppo.clip");
  EXPECT_EQ(clip.at("default"), "0.2");
  EXPECT_EQ(clip.at("low"), 0);
  EXPECT_EQ(clip.at("high"), 1);
}

TEST_F(Cli, ValuesOutOfRangeNameFileLineKeyAndRange) {
  expect_bad_input("train " + write("a.yaml", "name: a\n\nenv:\n  acoustics:\n    rays: 1e12\n"),
                   "a.yaml:5: env.acoustics.rays is 1e12; use a whole number from 0 to 2,147,483,647");
  expect_bad_input("train " + write("b.yaml", "name: a\n") + " ppo.clip=2",
                   "override 'ppo.clip=2': ppo.clip is 2; use a number above 0 and below 1");
  expect_bad_input("rir shoebox:5x3x4 --source 1,1,1 --listener 2,1,2 --set sh_order=6 --out " + file("x.wav"),
                   "--set sh_order=6: sh_order is 6; use a whole number from 0 to 5");
  expect_bad_input("scene " + write("s.yaml", "mesh: shoebox:3x3x3\nair:\n  temperature_c: 60\n"),
                   "s.yaml:3: air.temperature_c is 60; use a number from -20 to 50 degrees Celsius");
  expect_bad_input("dataset rir " + write("c.yaml", "shoeboxes: {count: 1}\nclearance_m: 0\n") + " --out " + file("corpus"),
                   "c.yaml:2: clearance_m is 0; use a number from 0.05 to 10 m");
  EXPECT_FALSE(std::filesystem::exists(file("x.wav")));
  EXPECT_FALSE(std::filesystem::exists(file("corpus")));
}

}  // namespace
}  // namespace earshot
