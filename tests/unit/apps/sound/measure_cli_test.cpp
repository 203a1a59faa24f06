// SPDX-License-Identifier: Apache-2.0
// `earshot measure FILE`, and parameters on request of `earshot rir --metrics`.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <nlohmann/json.hpp>
#include <numbers>
#include <span>
#include <string>
#include <vector>

#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/base/random.h"
#include "sim/base/text/json.h"
#include "tests/support/files/test_data.h"
#include "tests/support/programs/cli.h"

namespace earshot {
namespace {

/// Of `earshot measure`, which begins at 63 Hz; `earshot rir` begins at 125 Hz.
constexpr std::size_t k1kHz = 4;

class MeasureCli : public Cli {
 protected:
  [[nodiscard]] nlohmann::json measured(const std::string& arguments) const {
    const CliOutcome outcome = earshot("measure " + arguments + " --metrics " + file("m.json"));
    EXPECT_EQ(outcome.exit_code, 0) << arguments << "\n" << outcome.errors;
    return parse_json(read("m.json"));
  }
  /// Direct sound after `onset_s`, then noise that decays, over a floor 70 dB below the direct sound or elsewhere.
  std::vector<float> recorded(std::uint32_t stream, double onset_s, double t60_s, double level, double floor = 3e-4) const {
    const RandomStream random(38, Purpose::test, 6, stream);
    std::vector<float> samples(24000, 0.f);
    for (std::size_t n = 0; n < samples.size(); ++n) {
      const auto normal = random.normal2(static_cast<std::uint32_t>(n));
      const double t = static_cast<double>(n) / 16000 - onset_s - 0.003;
      const double decay = t < 0 ? 0 : level * std::exp(-3 * std::numbers::ln10 * t / t60_s);
      samples[n] = static_cast<float>(floor * static_cast<double>(normal[0]) + decay * static_cast<double>(normal[1]));
    }
    samples[static_cast<std::size_t>(std::lround(onset_s * 16000))] += 1.f;
    return samples;
  }
};

TEST_F(MeasureCli, FindsTheDirectSoundOfARecordedResponse) {
  for (std::uint32_t draw = 0; draw < 10; ++draw) {
    const RandomStream random(38, Purpose::test, 7, draw);
    const double onset_s = 0.02 + 0.3 * static_cast<double>(random.uniform(0)), t60_s = 0.3 + 0.5 * static_cast<double>(random.uniform(1)),
                 level = 0.02 + 0.05 * static_cast<double>(random.uniform(2));
    const std::vector<float> samples = recorded(draw, onset_s, t60_s, level);
    write_wav(file("r.wav"), samples, 1, 16000);
    double direct = 0, rest = 0;
    for (std::size_t n = 0; n < samples.size(); ++n) {
      const double from_s = static_cast<double>(n) / 16000 - onset_s;
      (std::abs(from_s) < 0.0025 ? direct : rest) += double{samples[n]} * double{samples[n]};
    }
    const nlohmann::json channel = measured(file("r.wav")).at("channels").at(0);
    EXPECT_NEAR(channel.at("direct_delay_s").get<double>(), onset_s, 1e-4) << draw;
    EXPECT_NEAR(channel.at("drr_db").get<double>(), 10 * std::log10(direct / rest), 0.05) << draw;
    // All of the floor is 29 dB below the response: no T20 (room_parameters.md).  At 90 dB below the direct sound there is one, up to the
    // chance of one noise in an octave.
    EXPECT_TRUE(channel.at("t20_s").at(k1kHz).is_null()) << draw;
    write_wav(file("quiet.wav"), recorded(draw, onset_s, t60_s, level, 3e-5), 1, 16000);
    const nlohmann::json quiet = measured(file("quiet.wav")).at("channels").at(0);
    ASSERT_TRUE(quiet.at("t20_s").at(k1kHz).is_number()) << draw;
    EXPECT_NEAR(quiet.at("t20_s").at(k1kHz).get<double>(), t60_s, 0.2 * t60_s) << draw;
    EXPECT_FALSE(channel.contains("sti") || channel.contains("j_lf"));
  }
}

TEST_F(MeasureCli, ThirdOctavesSpeechAndLateralParametersOnRequest) {
  std::vector<float> both(2 * 16000, 0.f);
  both[1600] = 1.f, both[16000 + 1600] = 0.f;
  both[2400] = 0.5f, both[16000 + 2400] = 0.3f;  // 50 ms later, cos 0.6
  write_wav(file("pair.wav"), both, 2, 16000);
  const nlohmann::json lateral = measured(file("pair.wav") + " --parameters lateral,speech --lateral-channel 1 --green");
  ASSERT_EQ(lateral.at("channels").size(), 1u);
  const nlohmann::json& channel = lateral.at("channels").at(0);
  EXPECT_NEAR(channel.at("j_lf").at(k1kHz).get<double>(), 0.09 / 1.25, 0.002);
  EXPECT_NEAR(channel.at("j_lfc").at(k1kHz).get<double>(), 0.15 / 1.25, 0.004);
  EXPECT_GT(channel.at("sti").get<double>(), 0.6);
  EXPECT_LT(measured(file("pair.wav") + " --parameters speech --speech-snr 0").at("channels").at(0).at("sti").get<double>(), 0.51);
  EXPECT_EQ(measured(file("pair.wav")).at("iacc").size(), 8u);
  EXPECT_EQ(measured(file("pair.wav") + " --bands third_octaves").at("bands_hz").size(), 20u);
  const nlohmann::json lacking = measured(file("pair.wav") + " --channel 0 --parameters lateral").at("channels").at(0);
  EXPECT_TRUE(lacking.at("j_lf").at(k1kHz).is_null());
  EXPECT_THAT(lacking.at("missing").at("j_lf").get<std::string>(), testing::HasSubstr("figure-of-eight"));
}

TEST_F(MeasureCli, BadInputIsOneLine) {
  write_wav(file("r.wav"), std::vector<float>(1600, 0.1f), 1, 16000);
  write_wav(file("short.wav"), std::vector<float>(100, 0.1f), 1, 16000);
  write_wav(file("other.wav"), std::vector<float>(1600, 0.1f), 1, 8000);
  write("text.wav", "no sound");
  const std::string r = "measure " + file("r.wav");
  expect_bad_input("measure " + file("absent.wav"), "absent.wav");
  expect_bad_input("measure " + file("text.wav"), "text.wav");
  expect_bad_input(r + " --bands halves", "octaves or third_octaves");
  expect_bad_input(r + " --channel 1", "which has 1 channels");
  expect_bad_input(r + " --direct-delay -1", "--direct-delay");
  expect_bad_input(r + " --direct-delay 100", "--direct-delay");
  expect_bad_input(r + " --direct-delay 100", "ends after 0.1 s");
  expect_bad_input(r + " --direct-delay nan", "--direct-delay");
  expect_bad_input(r + " --distance 0", "--distance");
  expect_bad_input(r + " --parameters loudness", "lateral, stage, speech");
  expect_bad_input(r + " --parameters interaural", "standard errors");
  expect_bad_input(r + " --speech-snr 3", "without 'speech'");
  expect_bad_input(r + " --lateral " + file("short.wav"), "without lateral parameters");
  expect_bad_input(r + " --parameters lateral --lateral " + file("short.wav"), "as many samples");
  expect_bad_input(r + " --parameters lateral --lateral " + file("other.wav"), "8000 Hz");
  expect_bad_input(r + " --parameters lateral --green --reference " + file("r.wav"), "one of them");
  expect_bad_input(r + " --green --reference " + file("r.wav"), "one of them");
  expect_bad_input(r + " --parameters lateral --lateral " + file("r.wav"), "the measured response itself");
  expect_bad_input(r + " --parameters lateral --lateral-channel 0", "the channel that is measured");
  expect_bad_input("rir shoebox:5x3x4 --source 1,1,1 --listener 3,1,2 --out " + file("x.wav") + " --parameters stage", "--metrics");
  expect_bad_input("rir shoebox:5x3x4 --source 1,1,1 --listener 3,1,2 --channels mono --out " + file("x.wav") + " --metrics " +
                       file("x.json") + " --parameters interaural",
                   "two ears");
}

// One channel of several is never taken without a word.
TEST_F(MeasureCli, NamesTheChannelOfFilesBesideTheMeasuredOne) {
  std::vector<float> both(2 * 16000, 0.f);
  both[1600] = 1.f, both[2400] = 0.5f, both[16000 + 2400] = 0.3f;
  write_wav(file("pair.wav"), both, 2, 16000);
  write_wav(file("one.wav"), std::span<const float>(both).first(16000), 1, 16000);
  const std::string pair = "measure " + file("pair.wav"), one = "measure " + file("one.wav");
  for (const int channel : {0, 1})
    expect_bad_input(pair + fmt::format(" --channel {0} --parameters lateral --lateral-channel {0}", channel),
                     "the channel that is measured");
  expect_bad_input(one + " --reference " + file("pair.wav"), "has 2 channels");
  expect_bad_input(one + " --parameters lateral --lateral " + file("pair.wav"), "--lateral-channel");
  const std::string named = " --parameters lateral --lateral " + file("pair.wav") + " --lateral-channel 1";
  const nlohmann::json channel = measured(file("one.wav") + named).at("channels").at(0);
  EXPECT_TRUE(channel.at("j_lf").at(k1kHz).is_number());
}

TEST_F(MeasureCli, StrengthOfAnUncalibratedRecordingIsMissing) {
  write_wav(file("r.wav"), recorded(1, 0.1, 0.4, 0.05), 1, 16000);
  const nlohmann::json plain = measured(file("r.wav")).at("channels").at(0),
                       green = measured(file("r.wav") + " --green").at("channels").at(0);
  for (const nlohmann::json& value : plain.at("g_db")) EXPECT_TRUE(value.is_null());
  EXPECT_THAT(plain.at("missing").at("g_db").get<std::string>(), testing::HasSubstr("reference"));
  EXPECT_TRUE(green.at("g_db").at(k1kHz).is_number() && !green.contains("missing"));
  EXPECT_THAT(earshot("measure --help").output, testing::HasSubstr("14 dB above"));
}

// A screen between source and listener, 1 m apart: neither the energy nor the samples of any channel have stage parameters.
TEST_F(MeasureCli, StageParametersNeedALineOfSight) {
  std::string obj;
  int corners = 0;
  const auto append_box = [&](double x0, double z0, double x1, double y1, double z1, bool inward) {
    for (int corner = 0; corner < 8; ++corner)
      obj += fmt::format("v {} {} {}\n", corner & 1 ? x1 : x0, corner & 2 ? y1 : 0.0, corner & 4 ? z1 : z0);
    constexpr std::array<std::array<int, 4>, 6> sides{{{1, 5, 7, 3}, {2, 4, 8, 6}, {1, 2, 6, 5}, {3, 7, 8, 4}, {1, 3, 4, 2}, {5, 6, 8, 7}}};
    for (const auto& [a, b, c, d] : sides)
      obj += inward ? fmt::format("f {} {} {} {}\n", corners + d, corners + c, corners + b, corners + a)
                    : fmt::format("f {} {} {} {}\n", corners + a, corners + b, corners + c, corners + d);
    corners += 8;
  };
  append_box(0, 0, 8, 3, 6, true);
  append_box(3.4, 1.2, 3.5, 2.2, 2.8, false);
  write("screen.obj", obj);
  const std::string options =
      " --preset fast --set rays=256 rir_length_s=1.2 --parameters stage --source 3,1.2,2 --listener 3.98,1.2,2 --out " + file("r.wav") +
      " --metrics " + file("r.json");
  const CliOutcome outcome = earshot("rir " + file("screen.obj") + options);
  ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  const nlohmann::json hidden = parse_json(read("r.json"));
  EXPECT_TRUE(hidden.at("direct_delay_s").is_null());
  for (const nlohmann::json& part : {hidden.at("energy"), hidden.at("rir"), hidden.at("ears").at("left")})
    for (const char* key : {"st_early_db", "st_late_db"}) {
      for (const nlohmann::json& value : part.at(key)) EXPECT_TRUE(value.is_null()) << part;
      EXPECT_THAT(part.at("missing").at(key).get<std::string>(), testing::HasSubstr("line of sight"));
    }
}

// In a rough shoebox far from the source the field is nearly diffuse: J_LF near 1/3 less the frontal part, LG near G less 5 dB.
TEST_F(MeasureCli, ResponsesHaveParametersWithErrorsOnRequest) {
  const std::string room =
      "rir shoebox:8x3x6@0.2 --preset fast --set rays=1024 rir_length_s=1.2 --out " + file("r.wav") + " --metrics " + file("r.json");
  const std::string far = room + " --source 2,1.5,2 --listener 6,1.6,4.3", near = room + " --source 3,1.5,2 --listener 3.8,1.5,2.6";
  ASSERT_EQ(earshot(far).exit_code, 0);
  const nlohmann::json plain = parse_json(read("r.json"));
  EXPECT_FALSE(plain.at("energy").contains("j_lf") || plain.at("standard_error").contains("sti"));
  ASSERT_EQ(earshot(far + " --parameters lateral,speech,interaural,stage").exit_code, 0);
  const nlohmann::json asked = parse_json(read("r.json"));
  const nlohmann::json &energy = asked.at("energy"), &errors = asked.at("standard_error");
  for (const char* key : {"j_lf", "j_lfc", "lg_db", "mti"}) {
    EXPECT_EQ(energy.at(key).size(), 7u);
    EXPECT_GT(errors.at(key).at(3).get<double>(), 0) << key;
    EXPECT_LT(errors.at(key).at(3).get<double>(), 0.3) << key;
  }
  for (const char* key : {"iacc", "iacc_early", "iacc_late"}) EXPECT_GT(errors.at(key).at(3).get<double>(), 0) << key;
  EXPECT_GT(errors.at("sti").get<double>(), 0);
  EXPECT_NEAR(energy.at("sti").get<double>(), asked.at("rir").at("sti").get<double>(), 0.03);
  EXPECT_GT(energy.at("j_lf").at(3).get<double>(), 0.05);
  EXPECT_LT(energy.at("j_lf").at(3).get<double>(), 0.45);
  EXPECT_GT(energy.at("j_lfc").at(3).get<double>(), energy.at("j_lf").at(3).get<double>());
  EXPECT_LT(energy.at("lg_db").at(3).get<double>(), energy.at("g_db").at(3).get<double>());
  EXPECT_TRUE(energy.at("st_early_db").at(3).is_null());
  EXPECT_THAT(energy.at("missing").at("st_early_db").get<std::string>(), testing::HasSubstr("1 m"));
  ASSERT_EQ(earshot(near + " --parameters stage").exit_code, 0);
  const nlohmann::json stage = parse_json(read("r.json"));
  for (const char* key : {"st_early_db", "st_late_db"}) {
    EXPECT_TRUE(stage.at("energy").at(key).at(3).is_number()) << stage.at("energy").at("missing");
    EXPECT_NEAR(stage.at("energy").at(key).at(3).get<double>(), stage.at("rir").at(key).at(3).get<double>(), 2) << key;
    EXPECT_GT(stage.at("standard_error").at(key).at(3).get<double>(), 0) << key;
  }
}

/// Is a first reflection of the room of 8 x 3 x 6 m, 2.1 to 2.9 ms after the direct sound, on the edge of what counts as direct sound?
bool is_on_the_edge(glm::dvec3 source, glm::dvec3 listener) {
  const glm::dvec3 size(8, 3, 6);
  for (int axis = 0; axis < 3; ++axis)
    for (const double wall : {0.0, size[axis]}) {
      glm::dvec3 image = source;
      image[axis] = 2 * wall - source[axis];
      const double after_s = (glm::distance(image, listener) - glm::distance(source, listener)) / 343.0;
      if (std::abs(after_s - 0.0025) < 0.0004) return true;
    }
  return false;
}

// What `rir` writes, `measure` reads back: the same parameters, with time zero from the samples alone, up to 0.4 ms before that of the
// energy response.
TEST_F(MeasureCli, RenderedResponsesReadAlike) {
  int measured_draws = 0;
  for (std::uint32_t draw = 0; measured_draws < 10 && draw < 60; ++draw) {
    const RandomStream random(38, Purpose::test, 8, draw);
    const auto within = [&](std::uint32_t i, double low, double high) {
      return low + (high - low) * static_cast<double>(random.uniform(i));
    };
    const glm::dvec3 source(within(0, 1, 3), 1.5, within(1, 1, 5)), listener(within(2, 4, 7), 1.6, within(3, 1, 5));
    if (is_on_the_edge(source, listener)) continue;
    ++measured_draws;
    const std::string pair =
        fmt::format("--source {:.3f},1.5,{:.3f} --listener {:.3f},1.6,{:.3f}", source.x, source.z, listener.x, listener.z);
    ASSERT_EQ(earshot("rir shoebox:8x3x6@0.2 --preset fast --channels mono --set rir_length_s=0.8 " + pair + " --out " + file("r.wav") +
                      " --metrics " + file("r.json"))
                  .exit_code,
              0);
    const nlohmann::json told = parse_json(read("r.json")), found = measured(file("r.wav")).at("channels").at(0);
    EXPECT_NEAR(found.at("direct_delay_s").get<double>(), told.at("direct_delay_s").get<double>(), 4e-4) << pair;
    EXPECT_NEAR(found.at("drr_db").get<double>(), told.at("rir").at("drr_db").get<double>(), 0.5) << pair;
    EXPECT_NEAR(found.at("c80_db").at(k1kHz).get<double>(), told.at("rir").at("c80_db").at(3).get<double>(), 0.2) << pair;
  }
  EXPECT_EQ(measured_draws, 10);
}

}  // namespace
}  // namespace earshot
