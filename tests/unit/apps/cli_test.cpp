// SPDX-License-Identifier: Apache-2.0
// Runs the program as a user does and checks its exit code and its output.

#include "tests/support/programs/cli.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>
#include <vector>

#include "sim/base/text/json.h"
#include "tests/support/acoustics/band_levels.h"

namespace {

using testing::HasSubstr;

using earshot::Cli;
using earshot::CliOutcome;

TEST_F(Cli, DoctorReportsTheMachine) {
  const CliOutcome outcome = earshot("doctor");
  EXPECT_EQ(outcome.exit_code, 0);
  for (const char* part : {"CPU", "Embree", "BLAS", "libtorch", "camera"}) EXPECT_THAT(outcome.output, HasSubstr(part));
}

TEST_F(Cli, BadScenesAreOneLineAndExitCodeTwo) {
  expect_bad_input("scene " + file("none.glb"), "does not exist");
  expect_bad_input("scene " + write("empty.obj", "# nothing\n"), "empty.obj");
  expect_bad_input("scene " + write("nan.obj", "v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n"), "nan.obj");
  expect_bad_input("scene shoebox:5x4", "shoebox");
  expect_bad_input("scene shoebox:5x3x4@unobtainium", "unobtainium");
  write("room.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  expect_bad_input("scene " + write("key.yaml", "mesh: room.obj\ncieling_m: 3\n"), "did you mean 'ceiling_m'");
  expect_bad_input("scene " + write("material.yaml", "mesh: room.obj\nassign: {\"*\": brik}\n"), "brik");
}

TEST_F(Cli, BadConfigsAndFilesAreOneLineAndExitCodeTwo) {
  expect_bad_input("train " + file("none.yaml"), "no such file");
  expect_bad_input("train " + write("typo.yaml", "ppo: {learning_rat: 1}\n"), "did you mean 'learning_rate'");
  expect_bad_input("train " + write("data.yaml", "data: {train: {file: " + file("none.json.gz") + "}}\n"), "does not exist");
  expect_bad_input("eval " + write("junk.ckpt", "junk"), "junk.ckpt");
  expect_bad_input("leaderboard " + write("junk.json", "{}"), "junk.json");
  expect_bad_input("eval random --episodes " + write("bad.json", "{\"episodes\": [{\"episode_id\": \"0\"}]}"), "bad.json");
  expect_bad_input("rir shoebox:5x3x4 --source 1,1,1 --listener 2,1,nan --out " + file("x.wav"), "--listener");
  expect_bad_input("rir shoebox:5x3x4 --source 1,1,1 --listener 2,1,2 --rate 100 --out " + file("x.wav"), "sample_rate_hz");
  expect_bad_input("rir shoebox:5x3x4 --source 1,1,1 --listener 2,1,2 --set raya=3 --out " + file("x.wav"), "did you mean 'rays'");
  EXPECT_FALSE(std::filesystem::exists(file("x.wav")));
}

// A key that changes nothing is refused, so that no run is read as what it is not.
TEST_F(Cli, SettingsWithoutEffectAreRefused) {
  const std::string high = "rir shoebox:5x3x4 --source 1,1,1 --listener 2,1,2 --preset high --out " + file("x.wav") + " --set ";
  expect_bad_input(high + "diffuse_last_segment=true", "has no effect on bidirectional tracing");
  expect_bad_input(high + "field=on diffuse_last_segment=true", "has no effect on a source field");
  expect_bad_input(high + "glide_paths=2", "has no effect on single responses");
  expect_bad_input(high + "temporal_reuse=on", "has no effect on single responses");
  EXPECT_FALSE(std::filesystem::exists(file("x.wav")));
}

// `field = on` gathers the late field of a single response too, in every preset.
TEST_F(Cli, RirGathersAFieldOnRequest) {
  const std::string room =
      "rir shoebox:5x3x4@0.2 --source 1.2,1.1,1.5 --listener 3.8,1.6,2.3 --channels mono --set rir_length_s=0.6 "
      "rays=512 source_rays=512 field_photons=4096 time_bin_s=0.004 sh_order=0 threads=1 ";
  for (const std::string preset : {"--preset high ", "--preset balanced "}) {
    const auto run = [&](const std::string& setting) {
      const CliOutcome outcome = earshot(room + setting + " " + preset + "--out " + file("f.wav") + " --metrics " + file("f.json"));
      EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
      return earshot::parse_json(read("f.json"));
    };
    const auto traced = run("field=off"), gathered = run("field=on");
    EXPECT_NE(traced.at("effects").at("late"), gathered.at("effects").at("late")) << preset;  // rays, photons
    EXPECT_TRUE(gathered.at("standard_error").at("t20_s").at(2).is_number());
    const double traced_t20 = traced.at("energy").at("t20_s").at(2), gathered_t20 = gathered.at("energy").at("t20_s").at(2);
    EXPECT_NEAR(gathered_t20, traced_t20, 0.15 * traced_t20) << preset;  // 4096 photons: 3 to 5 %
    EXPECT_NE(gathered_t20, traced_t20) << preset;
  }
}

// What the planner chose is a config like any other: its settings give the same bits without it.
TEST_F(Cli, RirPlansForAnAccuracy) {
  const std::string room =
      "rir shoebox:5x3x4@0.2 --source 1.2,1.1,1.5 --listener 3.8,1.6,2.3 --listener 2,1.4,3 --preset fast --channels mono ";
  const CliOutcome planned = earshot(room + "--accuracy t20=15%,edc=2dB --out " + file("a.wav") + " --metrics " + file("a.json"));
  ASSERT_EQ(planned.exit_code, 0) << planned.errors;
  const auto metrics = earshot::parse_json(read("a.json"));
  const auto accuracy = metrics.at("pairs").at(0).at("accuracy");
  EXPECT_EQ(accuracy.at("target"), "t20=15%,edc=2dB");
  EXPECT_LE(accuracy.at("predicted").at("t20_pct").get<double>(), 0.85 * 15);
  EXPECT_LE(accuracy.at("predicted").at("edc_db").get<double>(), 0.85 * 2);
  EXPECT_GE(accuracy.at("tried").size(), 2u);
  std::string settings = "--set";
  for (const auto& setting : accuracy.at("settings")) settings += " " + setting.get<std::string>();
  ASSERT_EQ(earshot(room + settings + " --out " + file("b.wav")).exit_code, 0);
  EXPECT_EQ(read("a.s0.l0.wav"), read("b.s0.l0.wav"));
  EXPECT_EQ(read("a.s0.l1.wav"), read("b.s0.l1.wav"));

  const std::string bad = "rir shoebox:5x3x4 --source 1,1,1 --listener 2,1,2 --out " + file("x.wav") + " --accuracy ";
  expect_bad_input(bad + "t20=5", "t20=5%,drr=1dB,edc=1dB");
  expect_bad_input(bad + "t20=5% --set rays=64", "sets a key that --accuracy chooses");
  expect_bad_input(bad + "t30=5%", "is not one of t20=, drr= and edc=");
  expect_bad_input(bad + "t20=5% --set rir_length_s=0.05", "cannot be measured");
  EXPECT_FALSE(std::filesystem::exists(file("x.wav")));
}

// O-1 through the command line: r = 2.765863 m in SHOE-1 (docs/evidence/oracles.md has z up, here it is y): amplitude 0.0287713,
// delay 8.06374 ms at c = 343 m/s, 343 / 343.2 of that here.
TEST_F(Cli, RirWritesSoundAndMetrics) {
  const CliOutcome outcome = earshot(
      "rir shoebox:5x3x4@0.2 --source 1.2,1.1,1.5 --listener 3.8,1.6,2.3 --preset fast --channels mono --set air_absorption=off "
      "--components --seed 5 --out " +
      file("r.wav") + " --metrics " + file("r.json"));
  ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  const auto document = earshot::parse_json(read("r.json"));
  EXPECT_NEAR(document.at("direct_amplitude").get<double>(), 0.0287713, 1e-4);
  EXPECT_NEAR(document.at("direct_delay_s").get<double>(), 2.765863 / 343.2, 1e-6);
  EXPECT_EQ(document.at("seed").get<int>(), 5);
  EXPECT_EQ(document.at("energy").at("rt60_s").size(), document.at("bands_hz").size());
  std::vector<float> sum;
  for (const char* part : {"r.direct.wav", "r.early.wav", "r.diffracted.wav", "r.transmitted.wav", "r.late.wav"}) {
    const std::vector<float> samples = read_wav(part);
    sum.resize(samples.size());
    for (std::size_t i = 0; i < samples.size(); ++i) sum[i] += samples[i];
  }
  const std::vector<float> whole = read_wav("r.wav");
  ASSERT_EQ(sum.size(), whole.size());
  for (std::size_t i = 0; i < whole.size(); ++i) ASSERT_NEAR(sum[i], whole[i], 1e-7) << "the parts add up, sample " << i;

  const std::string first = read("r.wav");
  ASSERT_EQ(earshot("rir shoebox:5x3x4@0.2 --source 1.2,1.1,1.5 --listener 3.8,1.6,2.3 --preset fast --channels mono --set "
                    "air_absorption=off --seed 5 --set threads=2 --out " +
                    file("r.wav"))
                .exit_code,
            0);
  EXPECT_EQ(read("r.wav"), first) << "same seed, other thread count: same bytes";
}

// A source behind a wall with a door beside the line of sight: every kind of path is there, and its part is not silent.
TEST_F(Cli, ComponentsOfAPairBehindAWall) {
  std::string corners, faces;
  const auto box = [&](double x0, double x1, double z0, double z1) {
    static const std::array<std::array<int, 3>, 12> sides{{{1, 2, 3},
                                                           {1, 3, 4},
                                                           {5, 7, 6},
                                                           {5, 8, 7},
                                                           {1, 6, 2},
                                                           {1, 5, 6},
                                                           {2, 7, 3},
                                                           {2, 6, 7},
                                                           {3, 8, 4},
                                                           {3, 7, 8},
                                                           {4, 5, 1},
                                                           {4, 8, 5}}};
    const auto first = std::count(corners.begin(), corners.end(), '\n');
    for (const double y : {0.0, 2.5})
      for (const auto& [x, z] : {std::pair{x0, z0}, {x1, z0}, {x1, z1}, {x0, z1}})
        corners += "v " + std::to_string(x) + " " + std::to_string(y) + " " + std::to_string(z) + "\n";
    for (const auto& side : sides)
      faces +=
          "f " + std::to_string(first + side[0]) + " " + std::to_string(first + side[1]) + " " + std::to_string(first + side[2]) + "\n";
  };
  box(-4, 4, -0.1, 0.1);
  write("wall.obj", corners + "usemtl panel\n" + faces);
  write(
      "db.json",
      R"({"materials": [{"name": "panel", "labels": ["default"], "absorption": [1000, 0.2], "scattering": [1000, 0.1], "transmission": [1000, 0.05], "source": "a test"}]})");
  write("wall.yaml", "mesh: wall.obj\nmaterials: db.json\nassign: {panel: panel}\n");
  const CliOutcome outcome = earshot("rir " + file("wall.yaml") +
                                     " --source 3,1,-2 --listener 3,1,2 --preset fast --channels mono --set diffraction=on --set "
                                     "transmission=on --set air_absorption=off --components --plot " +
                                     file("p.svg") + " --out " + file("p.wav") + " --metrics " + file("p.json"));
  ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  const auto energy = [&](const std::string& name) {
    double sum = 0;
    for (const float sample : read_wav(name)) sum += double{sample} * sample;
    return sum;
  };
  EXPECT_EQ(energy("p.direct.wav"), 0.0);
  EXPECT_GT(energy("p.diffracted.wav"), 0.0);
  EXPECT_THAT(read("p.svg"), HasSubstr("through walls"));
  EXPECT_NEAR(energy("p.transmitted.wav"), 0.05 / std::pow(4 * std::numbers::pi * 4, 2),
              0.02 * 0.05 / std::pow(4 * std::numbers::pi * 4, 2))
      << "tau / (4 pi r)^2";
  EXPECT_TRUE(earshot::parse_json(read("p.json")).at("direct_delay_s").is_null());
}

// The listener is 2 m ahead (-z) of a cardioid that turns: (1 + cos) / 2 of 1 / (4 pi 2 m), as the metrics say and as the samples are.
TEST_F(Cli, DirectSoundFollowsThePatternOfTheSource) {
  for (const int heading_deg : {0, 60, 90, 180, 240}) {
    const CliOutcome outcome =
        earshot("rir shoebox:9x4x9@0.9 --source 4.5,1.5,4.5 --listener 4.5,1.5,2.5 --source-pattern cardioid --source-heading " +
                std::to_string(heading_deg) + " --preset fast --channels mono --set air_absorption=off --components --out " +
                file("d.wav") + " --metrics " + file("d.json"));
    ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
    const double expected = (0.5 + 0.5 * std::cos(heading_deg * std::numbers::pi / 180)) / (4 * std::numbers::pi * 2);
    const auto heard = earshot::parse_json(read("d.json")).at("direct_amplitude");
    EXPECT_NEAR(heard.is_null() ? 0.0 : heard.get<double>(), expected, 1e-4) << heading_deg;
    double energy = 0;
    for (const float sample : read_wav("d.direct.wav")) energy += double{sample} * double{sample};
    // A pulse of the whole band has the amplitude as the root of its energy, but for the band's upper edge.
    EXPECT_NEAR(std::sqrt(energy), expected, 0.05 * expected + 1e-6) << heading_deg;
  }
}

TEST_F(Cli, SeveralSourcesAndListenersGiveAFileEach) {
  const CliOutcome outcome = earshot(
      "rir shoebox:5x3x4@0.2 --source 1,1,1 --source 4,1,1 --source-pattern omni,cardioid --source-heading 0,180 --listener 2,1.5,3 "
      "--listener 3,1.5,3 --preset fast --channels mono --out " +
      file("m.wav") + " --metrics " + file("m.json"));
  ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  for (const char* name : {"m.s0.l0.wav", "m.s0.l1.wav", "m.s1.l0.wav", "m.s1.l1.wav"})
    EXPECT_TRUE(std::filesystem::exists(file(name))) << name;
  EXPECT_EQ(earshot::parse_json(read("m.json")).at("pairs").size(), 4u);
  expect_bad_input("rir shoebox:5x3x4 --source 1,1,1 --listener 2,1,2 --source-pattern cardoid --out " + file("x.wav"), "cardioid");
  expect_bad_input("rir shoebox:5x3x4 --source 1,1,1 --listener 2,1,2 --heading nan --out " + file("x.wav"), "--heading");
  expect_bad_input("rir shoebox:5x3x4 --source 1,1,1 --listener 2,1,2 --simplify 0 --out " + file("x.wav"), "simplify_m");
  expect_bad_input("rir shoebox:5x3x4 --source 1,1,1 --listener 2,1,2 --plot " + file("x.wav") + " --out " + file("x.wav"), "two outputs");
  std::filesystem::create_directory(file("folder.wav"));
  expect_bad_input("rir shoebox:5x3x4 --source 1,1,1 --listener 2,1,2 --preset fast --out " + file("folder.wav"), "is a folder");
  expect_bad_input("rir shoebox:5x3x4 --source 1,1,1 --listener 2,1,2 --heading 0,90 --out " + file("x.wav"), "--heading");
}

TEST_F(Cli, HeadFiltersCanBeTurnedAgainstTheListener) {
  const std::string room = "rir shoebox:5x3x4@0.2 --source 1.2,1.1,1.5 --listener 3.8,1.6,2.3 --preset fast --set late=off ";
  ASSERT_EQ(earshot(room + "--heading 90 --out " + file("a.wav")).exit_code, 0);
  ASSERT_EQ(earshot(room + "--heading 50 --hrtf-orientation 40,0,0 --out " + file("b.wav")).exit_code, 0);
  ASSERT_EQ(earshot(room + "--heading 50 --out " + file("c.wav")).exit_code, 0);
  const std::vector<float> turned = read_wav("a.wav"), same = read_wav("b.wav"), other = read_wav("c.wav");
  double difference = 0;
  for (std::size_t i = 0; i < turned.size(); ++i) {
    ASSERT_NEAR(same[i], turned[i], 1e-5);
    difference = std::max<double>(difference, std::abs(other[i] - turned[i]));
  }
  EXPECT_GT(difference, 1e-3);
  expect_bad_input(room + "--hrtf-orientation 1,2 --out " + file("x.wav"), "--hrtf-orientation");
}

TEST_F(Cli, WalkHearsMovingSources) {
  write("poses.csv", "t_s,x,y,z,heading_deg\n0,1,1.5,1,0\n0.6,1,1.5,2,90\n");
  write("path.csv", "0,4,1.5,1,0\n0.6,4,1.5,3,0\n");
  const std::string room = "walk shoebox:5x3x4@0.3 --poses " + file("poses.csv") + " --sound synth:noise --set rays=16 ";
  ASSERT_EQ(earshot(room + "--source 4,1.5,1 --out " + file("a.wav")).exit_code, 0);
  ASSERT_EQ(earshot(room + "--source-path " + file("path.csv") + " --out " + file("b.wav")).exit_code, 0);
  const std::vector<float> rest = read_wav("a.wav"), moving = read_wav("b.wav");
  EXPECT_NE(rest, moving);
  // Two sources are the sum of each alone.
  ASSERT_EQ(earshot(room + "--source 4,1.5,1 --source-path " + file("path.csv") + " --out " + file("c.wav")).exit_code, 0);
  const std::vector<float> both = read_wav("c.wav");
  ASSERT_EQ(both.size(), rest.size());
  for (std::size_t i = 0; i < both.size(); ++i) ASSERT_NEAR(both[i], rest[i] + moving[i], 1e-6) << i;
  expect_bad_input(room + "--out " + file("x.wav"), "--source");
}

// 1 m/s away from the source, of which only the direct sound is heard: third octaves from 100 Hz to 7.9 kHz keep the level that the inverse
// square law gives.  Delays cross-faded from step to step lose up to 3.8 dB.
TEST_F(Cli, WalkDoesNotComb) {
  using namespace earshot::band_levels;
  const earshot::SoundClip noise = white_noise(80123, 16000.f, 9);
  earshot::write_wav(file("noise.wav"), noise.samples, 1, 16000.f);
  write("poses.csv", "0,4,2,3,0\n4,8,2,3,0\n");
  const std::string walk = "walk shoebox:12x4x6@0.5 --channels mono --set early=off late=off diffraction=off air_absorption=off --poses " +
                           file("poses.csv") + " --source 1,2,3 --sound " + file("noise.wav") + " --out " + file("w.wav");
  const auto worst_db = [&](const std::string& options, double step_s) {
    EXPECT_EQ(earshot(walk + options + " --step " + std::to_string(step_s)).exit_code, 0);
    const std::vector<float> heard = read_wav("w.wav");
    std::vector<float> expected(heard.size());
    for (std::size_t n = 0; n < heard.size(); ++n) {
      const double r = 3.0 + static_cast<double>(n) / 16000.0;
      const auto delay = static_cast<std::size_t>(std::lround(r / 343.0 * 16000.0));
      if (n >= delay) expected[n] = static_cast<float>(static_cast<double>(noise.samples[n - delay]) / (4.0 * std::numbers::pi * r));
    }
    return worst_difference_db(band_powers(heard, 16000), band_powers(expected, 16000));
  };
  for (const double step_s : {0.05, 0.15}) EXPECT_LT(worst_db("", step_s), 0.5) << step_s;
  EXPECT_GT(worst_db(" --set glide_paths=0", 0.05), 2.0) << "the test sees what it is for";
}

TEST_F(Cli, WalkIsAsLongAsItsPosesAndNeverSilent) {
  write("poses.csv", "t_s,x,y,z,heading_deg\n0,1,1.5,1,0\n1.5,3,1.5,3,90\n");
  const CliOutcome outcome = earshot("walk shoebox:5x3x4@0.3 --poses " + file("poses.csv") +
                                     " --source 4,1.5,1 --sound synth:noise --set rays=16 --out " + file("w.wav"));
  ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  EXPECT_GE(read("w.wav").size(), static_cast<std::size_t>(1.5 * 16000 * 2 * 4));
  expect_bad_input("walk shoebox:5x3x4@0.3 --poses " + write("back.csv", "1,0,0,0,0\n0,0,0,0,0\n") +
                       " --source 4,1.5,1 --sound synth:noise --out " + file("v.wav"),
                   "t_s is not larger");
}

TEST_F(Cli, WalkPlansForAnAccuracyOfOneSourceAtRest) {
  write("poses.csv", "t_s,x,y,z,heading_deg\n0,1,1.5,1,0\n1,3,1.5,3,90\n");
  const std::string walk =
      "walk shoebox:5x3x4@0.3 --poses " + file("poses.csv") + " --sound synth:noise --channels mono --out " + file("w.wav");
  const CliOutcome outcome = earshot(walk + " --source 4,1.5,1 --accuracy t20=20%");
  ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  EXPECT_NE(outcome.output.find("predicted t20"), std::string::npos) << outcome.output;
  EXPECT_GE(read("w.wav").size(), static_cast<std::size_t>(16000 * 4));
  expect_bad_input(walk + " --source 4,1.5,1 --source 4,1.5,2 --accuracy t20=20%", "one static source");
  expect_bad_input(walk + " --source 4,1.5,1 --refine-every 5 --accuracy t20=20%", "--refine-every");
}

TEST_F(Cli, WalkThroughAFieldIsReproducible) {
  write("poses.csv", "t_s,x,y,z,heading_deg\n0,1,1.5,1,0\n0.5,2,1.5,2,90\n");
  const std::string walk = "walk shoebox:5x3x4@0.3 --poses " + file("poses.csv") +
                           " --source 4,1.5,1 --sound synth:noise --set rays=16 rir_length_s=0.2 field_photons=8192 field_error=0.001 ";
  const auto heard = [&](const std::string& options) {
    const CliOutcome outcome = earshot(walk + options + " --out " + file("w.wav"));
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    return read("w.wav");
  };
  const std::string traced = heard("--set field=off"), gathered = heard("--set field=on");
  EXPECT_NE(traced, gathered);
  const std::string store = "--set field=on --field-store " + file("fields");
  EXPECT_EQ(heard(store), gathered);  // built and stored
  EXPECT_EQ(heard(store), gathered);  // read
  const std::string refined = heard("--set field=on --refine-every 3");
  EXPECT_NE(refined, gathered);  // the first blocks hear the coarse field
  EXPECT_EQ(heard("--set field=on --refine-every 3"), refined);
  expect_bad_input(walk + "--refine-every -1 --out " + file("x.wav"), "--refine-every");
}

TEST_F(Cli, WalkPastAMovingSourceReusesUnlessTold) {
  write("poses.csv", "t_s,x,y,z,heading_deg\n0,1,1.5,1,0\n0.5,1,1.5,1,90\n");
  write("path.csv", "t_s,x,y,z,heading_deg\n0,2,1.5,1,0\n0.5,2.5,1.5,1,0\n");
  const std::string walk = "walk shoebox:5x3x4@0.3 --poses " + file("poses.csv") + " --source-path " + file("path.csv") +
                           " --sound synth:noise --set rays=16 rir_length_s=0.2 ";
  const auto heard = [&](const std::string& options) {
    const CliOutcome outcome = earshot(walk + options + " --out " + file("w.wav"));
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    return read("w.wav");
  };
  const std::string automatic = heard("");
  EXPECT_EQ(heard("--set temporal_reuse=on"), automatic);
  EXPECT_NE(heard("--set temporal_reuse=off"), automatic);
}

TEST_F(Cli, MaterialsAreListedAndLinted) {
  const CliOutcome builtin = earshot("materials");
  EXPECT_EQ(builtin.exit_code, 0) << builtin.output;
  EXPECT_THAT(builtin.output, HasSubstr("0 findings"));
  const std::string slip =
      write("slip.json",
            R"({"materials": [{"name": "a", "labels": ["default"], "absorption": [125, 0.02, 250, 0.9], "scattering": [125, 0.1]}]})");
  const CliOutcome linted = earshot("materials --lint " + slip);
  EXPECT_EQ(linted.exit_code, 1);
  EXPECT_THAT(linted.output, HasSubstr("lint: a: "));
  expect_bad_input("materials " + write("bad.json", "{"), "bad.json");
}

TEST_F(Cli, SceneReportIsJson) {
  ASSERT_EQ(earshot("scene house:4,rooms=2,area_m2=24 --explain --json " + file("s.json")).exit_code, 0);
  const auto document = earshot::parse_json(read("s.json"));
  EXPECT_TRUE(document.at("holes").empty());
  EXPECT_GT(document.at("ray_efficiency").get<double>(), 0.999);
  EXPECT_GT(document.at("navigable_area_m2").get<double>(), 10.0);
  EXPECT_LT(document.at("navigable_area_m2").get<double>(), 24.0);
}

// A scene a thousand kilometres from the origin of its file: points on the command line and in CSVs are those of the file.
TEST_F(Cli, FarScenesSoundAsNearOnes) {
  const auto room = [&](const std::string& name, double x, double z) {
    std::string text;
    for (const double dx : {0.0, 5.0})
      for (const double y : {0.0, 3.0})
        for (const double dz : {0.0, 4.0})
          text += "v " + std::to_string(x + dx) + " " + std::to_string(y) + " " + std::to_string(z + dz) + "\n";
    return write(name, text + "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n");
  };
  const std::string near = room("near.obj", 0, 0), far = room("far.obj", 1e6, -2e5);
  const std::string options = " --preset fast --set rays=50 --set rir_length_s=0.1 --channels mono";
  const auto rir = [&](const std::string& scene, const std::string& points, const std::string& name) {
    const CliOutcome outcome =
        earshot("rir " + scene + points + options + " --out " + file(name + ".wav") + " --metrics " + file(name + ".json"));
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    return read(name + ".wav");
  };
  // Eighths of a metre are exact in float and in double, so nothing rounds.
  EXPECT_EQ(rir(far, " --source 1000001.25,1.125,-199998.5 --listener 1000003.75,1.625,-199997.75", "far"),
            rir(near, " --source 1.25,1.125,1.5 --listener 3.75,1.625,2.25", "near"));
  EXPECT_EQ(earshot::parse_json(read("far.json")).at("origin_m"), nlohmann::json({1e6, 0, -2e5}));
  EXPECT_EQ(earshot::parse_json(read("near.json")).at("origin_m"), nlohmann::json({0, 0, 0}));

  const auto walk = [&](const std::string& scene, const std::string& poses, const std::string& source, const std::string& name) {
    const CliOutcome outcome = earshot("walk " + scene + " --poses " + write(name + ".csv", poses) + source + options +
                                       " --sound synth:noise --step 0.1 --out " + file(name + ".wav"));
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    return read(name + ".wav");
  };
  EXPECT_EQ(walk(far, "t_s,x,y,z,heading_deg\n0,1000003.75,1.5,-199997.75,0\n0.2,1000003.75,1.5,-199998.75,0\n",
                 " --source 1000001.25,1.125,-199998.5", "far_walk"),
            walk(near, "\xEF\xBB\xBFt_s,x,y,z,heading_deg\r\n0,3.75,1.5,2.25,0\r\n0.2,3.75,1.5,1.25,0\r\n", " --source 1.25,1.125,1.5",
                 "near_walk"));

  const CliOutcome report = earshot("scene " + far + " --json " + file("scene.json"));
  EXPECT_THAT(report.output, HasSubstr("computation origin (1000000, 0, -200000)"));
  EXPECT_EQ(earshot::parse_json(read("scene.json")).at("origin_m"), nlohmann::json({1e6, 0, -2e5}));
  expect_bad_input("rir " + near + " --source 1e39,0,0 --listener 1,1,1 --out " + file("x.wav"), "is not a point");

  // Centimetres taken for metres: said on the way, by every command that loads the scene.
  const CliOutcome large = earshot("rir " + near + " --unit 1000 --source 1,1,1 --listener 2,1,1" + options + " --out " + file("x.wav"));
  EXPECT_EQ(large.exit_code, 0) << large.errors;
  EXPECT_THAT(large.errors, HasSubstr("is the unit right?"));
}

}  // namespace
