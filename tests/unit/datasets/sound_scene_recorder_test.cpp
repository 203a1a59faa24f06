// SPDX-License-Identifier: Apache-2.0
// Events of sound scenes: tails that belong to places, and moving sources against x(t - delay) in closed form.

#include "datasets/sound_scene_recorder.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include "datasets/rir_corpus_response.h"
#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/base/random.h"
#include "tests/support/envs/sound_scene_cases.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

constexpr float kRecorderRateHz = 16000;

class SoundSceneRecording : public testing::Test {
 protected:
  void set_up(const std::string& scene) {
    config_ = corpus_cases::dry_scenes();
    config_.rooms.channels = "mono";
    config_.rooms.acoustics.rir_length_s = 0.5f;
    scene_ = scene;
  }
  /// What is recorded of these events, mono.
  std::vector<float> recorded(const std::vector<SoundEvent>& events, glm::vec3 listener, std::size_t frames) {
    if (!room_) room_ = std::make_unique<CorpusRoom>(config_.rooms, 0, CorpusRoomSpec{.scene = scene_});
    if (!tables_) tables_ = corpus_tables(config_.rooms).front();
    SoundSceneRecorder recorder(config_, tables_);
    const CorpusListener at{.position = listener};
    std::vector<float> samples(frames);
    for (const SoundEvent& event : events)
      recorder.add({.room = *room_, .event = event, .listener = at, .source = SoundSource(event.path[0].position)},
                   {.frames = frames, .samples = samples});
    return samples;
  }
  TestFolder folder_{"sound_scene_recorder"};
  SoundSceneConfig config_;
  std::string scene_;
  std::unique_ptr<const CorpusRoom> room_;
  std::shared_ptr<const SynthesisTables> tables_;
};

// Two events in one walk are their sum in any case; so that powers add up, their tails are uncorrelated wherever they are, and one place
// has one tail whatever the event's number.
TEST_F(SoundSceneRecording, TailsBelongToPlacesAndNotToNumbers) {
  set_up("shoebox:7x3x6@0.15");
  std::vector<float> click(16000);
  click[0] = 1;
  const std::string sound = (folder_.path() / "click.wav").string();
  write_wav(sound, click, 1, kRecorderRateHz);
  const RandomStream random(33, Purpose::test, 8);
  const auto place = [&](std::uint32_t draw) {
    const auto u = random.uniform4(draw);
    return glm::vec3(0.7f + 5.6f * u[0], 0.7f + 1.6f * u[1], 0.7f + 4.6f * u[2]);
  };
  const auto event = [&](int number, std::uint32_t draw, bool moves) {
    SoundEvent made{.number = number, .sound = sound, .onset_s = 0, .offset_s = 0.5, .path = {{0, place(draw)}}};
    if (moves) made.path.push_back({0.5, place(draw + 1)});
    return made;
  };
  for (std::uint32_t i = 0; i < 12; ++i) {
    const glm::vec3 listener = place(100 + i);
    const bool first_moves = i % 3 == 1, second_moves = i % 3 != 0;
    const std::vector<float> a = recorded({event(0, 10 * i, first_moves)}, listener, 8000),
                             b = recorded({event(0, 10 * i + 2, second_moves)}, listener, 8000);
    EXPECT_EQ(recorded({event(1, 10 * i, first_moves)}, listener, 8000), a);
    double product = 0, of_a = 0, of_b = 0;
    for (std::size_t n = 2400; n < a.size(); ++n) {  // behind every early path
      const double x{a[n]}, y{b[n]};
      product += x * y, of_a += x * x, of_b += y * y;
    }
    // A thousand samples that count: five standard errors.
    EXPECT_LT(std::abs(product) / std::sqrt(of_a * of_b), 0.16) << i;
  }
}

// The direct sound of a source that passes at up to 30 m/s, heard from where it was, from the onset on.
TEST_F(SoundSceneRecording, AMovingSourceIsHeardFromWhereItWas) {
  set_up("shoebox:100x8x50@1");
  config_.rooms.acoustics.early = config_.rooms.acoustics.late = config_.rooms.acoustics.diffraction =
      config_.rooms.acoustics.air_absorption = Switch::off;
  std::vector<float> tones(16000);
  const auto tone_at = [](double t_s) {
    double sum = 0;
    for (const double hz : {127.0, 311.0, 523.0, 733.0, 997.0}) sum += std::sin(2 * std::numbers::pi * hz * t_s);
    return sum;
  };
  for (std::size_t n = 0; n < tones.size(); ++n) tones[n] = static_cast<float>(tone_at(static_cast<double>(n) / kRecorderRateHz));
  const std::string sound = (folder_.path() / "tones.wav").string();
  write_wav(sound, tones, 1, kRecorderRateHz);
  constexpr double c = 343.2, sounding_s = 1;
  for (std::uint32_t i = 0; i < 10; ++i) {
    const RandomStream random(33, Purpose::test, 9, i);
    const auto in = [&](std::uint32_t draw, double low, double high) {
      return low + (high - low) * static_cast<double>(random.uniform(draw));
    };
    const double speed = in(0, 5, 30), onset_s = 0.001 * std::floor(in(1, 0, 300));
    const glm::dvec3 listener(in(2, 20, 80), in(3, 1, 4), 5), start(i % 2 == 0 ? 15 : 85, in(4, 1, 4), in(5, 30, 45)),
        velocity(i % 2 == 0 ? speed : -speed, 0, 0);
    const SoundEvent event{.sound = sound,
                           .onset_s = onset_s,
                           .offset_s = onset_s + sounding_s,
                           .path = {{0, glm::vec3(start)}, {2, glm::vec3(start + 2.0 * velocity)}}};
    const std::vector<float> heard = recorded({event}, glm::vec3(listener), 24000);
    // Of unit root mean square while it sounds: whole periods of five tones.
    const double factor = 1 / std::sqrt(5 * 0.5);
    double difference = 0, power = 0;
    for (std::size_t n = 0; n < heard.size(); ++n) {
      const double t = static_cast<double>(n) / kRecorderRateHz - onset_s;
      const glm::dvec3 apart = listener - (start + t * velocity);
      const double a = c * c - glm::dot(velocity, velocity), b = glm::dot(apart, velocity);
      const double delay = (b + std::sqrt(b * b + a * glm::dot(apart, apart))) / a, emitted = t - delay;
      // The block in which the sound begins leads from a source at rest; the end is cut within a sample.
      if (emitted < 0.06 || emitted > sounding_s - 0.01) continue;
      const double expected = factor * tone_at(emitted) / (4 * std::numbers::pi * c * delay);
      difference += std::pow(static_cast<double>(heard[n]) - expected, 2);
      power += expected * expected;
    }
    // Delays on straight lines between steps of 50 ms, at least 25 m away, leave up to 0.08 of a radian at 1 kHz.
    EXPECT_LT(10 * std::log10(difference / power), -20) << i << ": " << speed << " m/s";
  }
}

}  // namespace
}  // namespace earshot
