// Events of sound scenes: tails that belong to places.

#include "datasets/sound_scene_recorder.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
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

}  // namespace
}  // namespace earshot
