// SPDX-License-Identifier: Apache-2.0
// Recordings of sound scenes: what the labels say is where the sound comes from.

#include "datasets/sound_scene_corpus.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <sstream>
#include <string>
#include <vector>

#include "datasets/rir_corpus_room.h"
#include "datasets/sound_scene_events.h"
#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/base/errors.h"
#include "tests/support/envs/env_cases.h"
#include "tests/support/envs/sound_scene_cases.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using corpus_cases::dry_scenes;
using corpus_cases::lines_of;
using corpus_cases::read_float_wav;
using testing::HasSubstr;

using Row = std::array<int, 6>;  ///< frame, class, source, azimuth, elevation, distance

std::vector<Row> rows_of(const std::string& csv) {
  std::vector<Row> rows;
  std::istringstream lines(csv);
  for (std::string line; std::getline(lines, line);) {
    Row row{};
    EXPECT_EQ(std::sscanf(line.c_str(), "%d,%d,%d,%d,%d,%d", &row[0], &row[1], &row[2], &row[3], &row[4], &row[5]), 6) << line;
    rows.push_back(row);
  }
  return rows;
}

// Direction of arrival by the active intensity of the four channels, W times (X, Y, Z) in the axes of ambisonics: x ahead, y to the left, z
// up (Merimaa and Pulkki 2005, section 2), beside the labels of the frames in which one event sounds.
TEST(SoundSceneCorpus, LabelsAreWhereTheIntensityPoints) {
  SoundSceneConfig config = dry_scenes();
  config.max_overlap = 1;
  const TestFolder folder("scene_directions");
  write_sound_scenes(config, {.out = folder.path(), .threads = 2, .shard = {}, .progress = {}});
  int compared = 0, moving = 0, left = 0, right = 0;
  for (const auto& line : lines_of(folder.path() / "manifest.jsonl")) {
    const auto wav = read_float_wav(read_file(folder.path() / line["file"].get<std::string>()));
    ASSERT_EQ(wav.channels.size(), 4u);
    ASSERT_EQ(wav.channels[0].size(), 64'000u);
    for (const Row& row : rows_of(read_file(folder.path() / line["metadata_file"].get<std::string>()))) {
      // Frames that begin and end within the event and after the sound has come, and hold no other's.
      const auto& event = line["events"][static_cast<std::size_t>(row[2])];
      EXPECT_EQ(event["source"], row[2]);
      EXPECT_EQ(event["class_index"], row[1]);
      const double begin_s = 0.1 * row[0], end_s = begin_s + 0.1;
      bool alone = event["onset_s"].get<double>() + 0.06 < begin_s && event["offset_s"].get<double>() > end_s;
      for (const auto& other : line["events"])
        if (other != event && other["onset_s"].get<double>() < end_s && other["offset_s"].get<double>() + 0.2 > begin_s) alone = false;
      if (!alone) continue;
      double x = 0, y = 0, z = 0;
      for (std::size_t n = static_cast<std::size_t>(1600 * row[0]); n < static_cast<std::size_t>(1600 * (row[0] + 1)); ++n) {
        const double w = wav.channels[0][n];
        y += w * wav.channels[1][n], z += w * wav.channels[2][n], x += w * wav.channels[3][n];
      }
      const double degree = 180 / std::numbers::pi, azimuth = degree * std::atan2(y, x),
                   elevation = degree * std::atan2(z, std::hypot(x, y));
      // 1.5 m/s at 1 m are 9 degrees in a frame, of whose middle the label is; a tone's reflection of amplitude 0.03 turns the intensity
      // by 4 degrees at most, and the label is a whole number.
      const double across = std::cos(elevation / degree);
      EXPECT_NEAR(across * std::remainder(azimuth - row[3], 360.0), 0, 6) << line["id"] << " frame " << row[0];
      EXPECT_NEAR(elevation, row[4], 6) << line["id"] << " frame " << row[0];
      ++compared;
      moving += event["path"].size() > 1;
      (row[3] > 0 ? left : right) += std::abs(row[3]) > 10 && std::abs(row[3]) < 170;
    }
  }
  EXPECT_GT(compared, 60);
  EXPECT_GT(moving, 15);
  EXPECT_GT(left, 10);
  EXPECT_GT(right, 10);
}

TEST(SoundSceneCorpus, PlansKeepWhatTheConfigAsks) {
  SoundSceneConfig config = dry_scenes();
  config.events = {6, 9};
  config.max_overlap = 2;
  config.rooms.min_distance_m = 1;
  const ClassSounds sounds = expand_classes(config);
  const CorpusRoom room(config.rooms, 0, list_corpus_rooms(config.rooms)[0]);
  int moving = 0, events = 0, most = 0;
  for (int recording = 0; recording < 20; ++recording) {
    const SoundScenePlan plan = plan_sound_scene(config, sounds, room, 0, recording);
    ASSERT_LE(plan.events.size(), 9u);
    for (std::size_t i = 0; i < plan.events.size(); ++i) {
      const SoundEvent& event = plan.events[i];
      EXPECT_EQ(event.number, static_cast<int>(i));
      EXPECT_GE(event.onset_s, plan.events[i > 0 ? i - 1 : 0].onset_s);
      EXPECT_GE(event.onset_s, 0);
      EXPECT_LE(event.offset_s, 4 + 1e-9);
      EXPECT_TRUE(event.sound.starts_with(event.class_index == 0 ? "synth:noise:" : "synth:engine:")) << event.sound;
      for (double t_s = 0; t_s <= event.offset_s - event.onset_s; t_s += 0.05) {
        const glm::vec3 position = event.position_at(t_s), next_position = event.position_at(t_s + 0.01);
        EXPECT_GE(glm::length(position - plan.listener.position), 1 - 1e-3f);
        EXPECT_LE(glm::length(next_position - position), 0.0101f * 1.5f);  // the fastest; a way that turns is shorter
      }
      ++events;
      moving += event.moves();
    }
    for (int frame = 0; frame < 400; ++frame) {
      const double t_s = 0.01 * frame;
      most = std::max(most, static_cast<int>(std::ranges::count_if(
                                plan.events, [&](const SoundEvent& event) { return event.onset_s <= t_s && event.offset_s > t_s; })));
    }
  }
  EXPECT_EQ(most, 2);
  EXPECT_GT(moving, events / 4);
  EXPECT_LT(moving, 3 * events / 4);
}

// By hand: ahead is -z at heading 0, so that -x is to the left.
TEST(SoundSceneCorpus, RowsAreCountedByHand) {
  SoundScenePlan plan;
  plan.listener.position = {1, 1, 1};
  plan.events = {
      {.class_index = 3, .number = 0, .sound = {}, .onset_s = 0.1, .offset_s = 0.26, .path = {{0, {-1, 1, 1}}}},
      {.class_index = 1, .number = 1, .sound = {}, .onset_s = 0.0, .offset_s = 0.2, .path = {{0, {1, 2, 0}}, {0.1, {1, 1, -1}}}}};
  // Frame 0, at 0.05 s: the second half-way, one half above, two and a half... its place is (1, 1.5, -0.5).
  EXPECT_EQ(dcase_metadata(plan, 0.4f),
            "0,1,1,0,18,158\n"
            "1,3,0,90,0,200\n"
            "1,1,1,0,0,200\n"
            "2,3,0,90,0,200\n");
}

// A corpus is not completed with another sound of the same name.
TEST(SoundSceneCorpus, SoundsAreKnownByNameAndSize) {
  const TestFolder folder("scene_sounds");
  const std::string file = (folder.path() / "alarm.wav").string(), out = (folder.path() / "out").string();
  SoundSceneConfig config = dry_scenes();
  config.rooms.shoeboxes.count = config.recordings_per_room = 1;
  config.duration_s = 1;
  config.event_s = {0.3f, 0.5f};
  config.classes = {{"alarm", {file}}};
  const auto refused = [&] {
    return message_of<InputError>([&] { write_sound_scenes(config, {.out = out, .threads = 1, .shard = {}, .progress = {}}); });
  };
  EXPECT_THAT(refused(), HasSubstr("alarm.wav: cannot be read"));
  EXPECT_FALSE(std::filesystem::exists(out));
  write_wav(file, std::vector<float>(16000, 0.5f), 1, 16000);
  write_sound_scenes(config, {.out = out, .threads = 1, .shard = {}, .progress = {}});
  write_wav(file, std::vector<float>(17000, 0.5f), 1, 16000);
  EXPECT_THAT(refused(), HasSubstr("started with other settings: 'sounds"));
  const std::string other = (folder.path() / "caf\xE9.wav").string();
  std::filesystem::copy_file(file, other);
  config.classes = {{"alarm", {other}}};
  EXPECT_THAT(refused(), HasSubstr("has a name that is not valid UTF-8"));
}

TEST(SoundSceneCorpus, ConfigsAreCheckedByKey) {
  const TestFolder folder("scene_yaml");
  const auto refused = [&](const std::string& yaml) {
    write_text(folder.path() / "scenes.yaml", "shoeboxes: {count: 1}\n" + yaml);
    return message_of<InputError>([&] { load_sound_scene_config((folder.path() / "scenes.yaml").string(), {}); });
  };
  const std::string classes = "classes: {alarm: synth:alarm}\n";
  EXPECT_THAT(refused(""), HasSubstr("lists no class"));
  EXPECT_THAT(refused(classes + "listeners_per_source: 3\n"), HasSubstr("has no effect"));
  EXPECT_THAT(refused(classes + "moving: 2\n"), HasSubstr("moving"));
  EXPECT_THAT(refused(classes + "event_s: [1, 40]\n"), HasSubstr("event_s"));
  EXPECT_THAT(refused(classes + "max_overlpa: 1\n"), HasSubstr("did you mean 'max_overlap'"));
}

}  // namespace
}  // namespace earshot
