// SPDX-License-Identifier: Apache-2.0
// Sound of environments in channels other than two ears.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "envs/config/env_config.h"
#include "sim/audio/transforms/low_pass.h"
#include "sim/audio/transforms/spectrogram.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "tests/support/envs/env_cases.h"

namespace earshot {
namespace {

using testing::HasSubstr;

constexpr std::size_t kStepSamples = 2400;  // samples of a step

EnvConfig config_with(const std::string& channels) {
  EnvConfig config = quick_env_config();
  config.observation.channels = channels;
  config.observation.depth = config.observation.pointgoal = false;
  config.observation.waveform = config.observation.heard = true;
  config.acoustics.rir_length_s = 0.3f;
  config.task.max_steps = 100;
  return config;
}

BatchedEnv env_with(const EnvConfig& config) {
  return {config, make_set({room_episode("shoebox:6x3x5@0.5", {1.5f, 0, 1.5f}, 0.4, {4.5f, 0, 3.5f}, "synth:noise")}),
          make_scene_cache(config), 1};
}

/// The sound of all steps, [channels][samples], the first window before it.
std::vector<std::vector<float>> heard_by(const std::string& channels, const std::vector<Action>& actions) {
  BatchedEnv env = env_with(config_with(channels));
  env.reset();
  const auto count = static_cast<std::size_t>(ListenerLayout::named(channels).num_channels());
  std::vector<std::vector<float>> sound(count);
  const auto append = [&](std::span<const float> rows) {
    const std::size_t samples = rows.size() / count;
    for (std::size_t c = 0; c < count; ++c)
      sound[c].insert(sound[c].end(), rows.begin() + static_cast<std::ptrdiff_t>(c * samples),
                      rows.begin() + static_cast<std::ptrdiff_t>((c + 1) * samples));
  };
  append(float_rows(env, "heard"));
  for (const Action action : actions) {
    const std::int32_t number = static_cast<std::int32_t>(action);
    env.step(std::span(&number, 1));
    append(float_rows(env, "waveform"));
  }
  return sound;
}

double ratio_db(std::span<const float> of, std::span<const float> over) {
  double a = 0, b = 0;
  for (std::size_t n = 0; n < of.size(); ++n) {
    a += static_cast<double>(of[n]) * static_cast<double>(of[n]);
    b += static_cast<double>(over[n]) * static_cast<double>(over[n]);
  }
  return 10 * std::log10(a / b);
}

std::vector<Action> drawn_actions(int count) {
  const RandomStream random(23, Purpose::test);
  std::vector<Action> actions;
  for (int i = 0; i < count; ++i)
    actions.push_back(std::array{Action::forward, Action::left, Action::right}[random.below(3, static_cast<std::uint32_t>(i))]);
  return actions;
}

// Microphones in one place hear a + (1 - a) cos of what first-order harmonics hold: in every sample, while the agent walks and turns.
TEST(ChannelLayouts, AStreamIsTheMixOfTheHarmonicsOfTheSameWalk) {
  const std::vector<Action> actions = drawn_actions(12);
  const auto field = heard_by("ambisonic:1:ego", actions);  // W, left, up, ahead
  for (const char* name : {"stereo", "stereo:ms", "quad", "surround_5_1", "surround_7_1"}) {
    const auto sound = heard_by(name, actions);
    const ListenerLayout layout = ListenerLayout::named(name);
    ASSERT_EQ(sound[0].size(), 16000 + actions.size() * kStepSamples);
    for (std::size_t c = 0; c < sound.size(); ++c) {
      const Microphone& microphone = layout.microphones[c];
      if (microphone.lowpass_hz > 0) continue;
      const float a = microphone.omni_weight().value();
      const glm::vec3 front = microphone.orientation * glm::vec3(0, 0, -1);
      std::vector<float> expected(sound[c].size()), difference(sound[c].size());
      for (std::size_t n = 0; n < expected.size(); ++n) {
        expected[n] = a * field[0][n] + (1 - a) * (-front.x * field[1][n] + front.y * field[2][n] - front.z * field[3][n]) / std::sqrt(3.f);
        difference[n] = sound[c][n] - expected[n];
      }
      // A low-pass makes the filters of paths longer, so that the tails of delayed impulses are cut later.
      const bool has_low_pass = layout.num_channels() > 4;
      EXPECT_LT(ratio_db(difference, expected), has_low_pass ? -45 : -70) << name << " " << c;
    }
  }
}

// Turns do not change what an omnidirectional microphone hears, so its low-pass may come after the stream.
TEST(ChannelLayouts, TheLowFrequencyChannelIsTheLowPassOfTheOmnidirectionalStream) {
  const std::vector<Action> turns(8, Action::left);
  const auto omni = heard_by("ambisonic:1:ego", turns), surround = heard_by("surround_7_1", turns);
  std::vector<float> expected = omni[0];
  LowPass(120, 16000).filter(expected);
  std::vector<float> difference(expected.size());
  for (std::size_t n = 0; n < expected.size(); ++n) difference[n] = surround[3][n] - expected[n];
  const std::size_t settled = 8000;  // silence came before the window for the filter, sound for the stream
  EXPECT_LT(ratio_db(std::span(difference).subspan(settled), std::span(expected).subspan(settled)), -45);
  EXPECT_LT(ratio_db(surround[3], omni[0]), -10) << "most of the noise lies above";
}

TEST(ChannelLayouts, SensorsHaveARowOrALayerForEachChannel) {
  for (const char* name : {"mono", "stereo:ab", "binaural", "quad", "surround_5_1", "surround_7_1", "ambisonic:2"}) {
    EnvConfig config = config_with(name);
    config.observation.spectrogram = true;
    BatchedEnv env = env_with(config);
    const int channels = ListenerLayout::named(name).num_channels();
    EXPECT_EQ(find_sensor(env.sensors(), "spectrogram")->shape, (std::vector<int>{65, 26, channels})) << name;
    EXPECT_EQ(find_sensor(env.sensors(), "waveform")->shape, (std::vector<int>{channels, 2400})) << name;
    EXPECT_EQ(find_sensor(env.sensors(), "heard")->shape, (std::vector<int>{channels, 16000})) << name;
    env.reset();
    const std::int32_t forward = static_cast<std::int32_t>(Action::forward);
    env.step(std::span(&forward, 1));
    const auto step = float_rows(env, "waveform"), heard = float_rows(env, "heard"), picture = float_rows(env, "spectrogram");
    for (std::size_t c = 0; c < static_cast<std::size_t>(channels); ++c) {
      double energy = 0;
      for (std::size_t n = 0; n < kStepSamples; ++n) {
        ASSERT_EQ(step[c * kStepSamples + n], heard[(c + 1) * 16000 - kStepSamples + n]) << name;
        energy += std::abs(static_cast<double>(step[c * kStepSamples + n]));
      }
      SpectrogramAnalyzer alone(env.config().observation.sound);
      std::vector<float> layer(picture.size() / static_cast<std::size_t>(channels));
      alone.analyze(std::span(heard).subspan(c * 16000, 16000), layer);
      for (std::size_t cell = 0; cell < layer.size(); ++cell)
        ASSERT_EQ(picture[cell * static_cast<std::size_t>(channels) + c], layer[cell]) << name << " " << c;
      EXPECT_GT(energy, 0) << name << " " << c;
    }
  }
}

TEST(ChannelLayouts, WhatCannotBeIsRefused) {
  const auto expect_refused = [](const std::string& text, const std::string& part) {
    try {
      ConfigReader reader = ConfigReader::from_text(text, "env.yaml");
      EnvConfig config;
      read(reader, config);
      reader.finish();
      validate(config);
      ADD_FAILURE() << "accepted " << text;
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr(part)) << text;
    }
  };
  expect_refused("seed: 1\nobservation:\n  channels: surround_5_2\n", "env.yaml:3: observation.channels: listener 'surround_5_2'");
  expect_refused("observation: {channels: surround_5_2}", "quad, surround_5_1, surround_7_1");
  expect_refused("observation: {channels: quad, interaural: true}", "observation.interaural");
  expect_refused("observation: {channels: \"ambisonic:9\"}", "at most 64");
  expect_refused("{hrtf: head.sofa, observation: {channels: mono}}", "hrtf");
}

}  // namespace
}  // namespace earshot
