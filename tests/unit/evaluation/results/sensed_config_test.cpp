// SPDX-License-Identifier: Apache-2.0
// Files that decide what is heard enter by their content, wherever they lie.
#include "evaluation/results/sensed_config.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "sim/base/files.h"
#include "sim/base/random.h"
#include "tests/support/error_message.h"
#include "tests/support/files/test_files.h"
#include "trainer/run/effective_config.h"

namespace earshot {
namespace {

using testing::HasSubstr;
using testing::Not;

class MicrophoneFiles : public testing::Test {
 protected:
  /// A folder with two microphones, one of them of a measured pattern, and the pattern alone.
  std::filesystem::path written(const std::string& name, double azimuth_deg, double gain_db) const {
    const std::filesystem::path folder = folder_.path() / name;
    std::filesystem::create_directories(folder);
    write_text(folder / "mics.yaml",
               fmt::format("microphones:\n  - {{azimuth_deg: {}, omni_weight: 0.5}}\n  - {{pattern: side.json}}\n", azimuth_deg));
    write_text(
        folder / "side.json",
        fmt::format(R"({{"frequencies_hz": [1000], "azimuths_deg": [0, 180], "elevations_deg": [0], "gains_db": [[[0, {}]]]}})", gain_db));
    return folder;
  }
  static RunConfig config_with(const std::string& channels) {
    RunConfig config;
    config.env.observation.channels = channels;
    return config;
  }

  TestFolder folder_{"sensed_config"};
};

TEST_F(MicrophoneFiles, EnterTheSensesByTheirContent) {
  const RandomStream random(5, Purpose::test, 0, 0);
  const double azimuth = 90 * static_cast<double>(random.uniform(0)), gain = -20 * static_cast<double>(random.uniform(1)) - 1;
  const auto first = written("a", azimuth, gain), same = written("b", azimuth, gain), turned = written("c", azimuth + 1, gain),
             weaker = written("d", azimuth, gain - 1);
  const auto senses = [](const std::string& channels) { return sensed_config(config_with(channels).env); };
  const auto array = [](const std::filesystem::path& folder) { return "array:" + (folder / "mics.yaml").string(); };
  const auto mono = [](const std::filesystem::path& folder) { return "mono:" + (folder / "side.json").string(); };
  EXPECT_EQ(senses(array(first)), senses(array(same)));
  EXPECT_NE(senses(array(first)), senses(array(turned)));
  EXPECT_NE(senses(array(first)), senses(array(weaker)));
  EXPECT_EQ(senses(mono(first)), senses(mono(turned)));
  EXPECT_NE(senses(mono(first)), senses(mono(weaker)));
  for (const std::string& channels : {array(first), mono(first)}) {
    EXPECT_THAT(senses(channels).at("observation.channels"), Not(HasSubstr(first.string())));
    EXPECT_THAT(error_message([&] {
                  static_cast<void>(env_of_senses({{"observation.channels", channels}}, "result.json"));
                }),
                AllOf(HasSubstr("result.json"), HasSubstr("no file is opened")));
  }
  EXPECT_EQ(senses("ambisonic:2").at("observation.channels"), "ambisonic:2");
}

// Workers with other files do not become one run.
TEST_F(MicrophoneFiles, AreCommonToTheWorkersOfARun) {
  const auto folder = written("a", 30, -6);
  for (const std::string& channels : {"array:" + (folder / "mics.yaml").string(), "mono:" + (folder / "side.json").string()}) {
    const std::string before = common_settings(config_with(channels));
    EXPECT_EQ(common_settings(config_with(channels)), before);
    written("a", 30, -7);
    EXPECT_NE(common_settings(config_with(channels)), before) << channels;
    written("a", 30, -6);
  }
  RunConfig heads = config_with("binaural");
  heads.env.hrtf = (folder / "head.sofa").string();
  write_text(heads.env.hrtf, "one");
  const std::string before = common_settings(heads);
  write_text(heads.env.hrtf, "two");
  EXPECT_NE(common_settings(heads), before);
}

}  // namespace
}  // namespace earshot
