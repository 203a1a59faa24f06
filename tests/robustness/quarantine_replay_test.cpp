// SPDX-License-Identifier: Apache-2.0
#include "envs/batch/quarantine_replay.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "tests/support/envs/env_cases.h"

namespace earshot {
namespace {

QuarantineRecord example() {
  return {.report = {Fault::sound, "value 3 of 4800 is inf"},
          .engine = "0123456789ab-dirty",
          .set_hash = 0xFEDCBA9876543210u,
          .seed = 18446744073709551615u,
          .episode_index = 77,
          .env = 12,
          .episode_count = 3,
          .step = 4,
          .actions = {1, 2, 3, 1},
          .episode = room_episode("shoebox:6x3x5", {1, 0, 1}, 0.5, {4, 0, 3}, "synth:noise"),
          .config = config_text(quick_env_config())};
}

TEST(QuarantineRecord, RoundTrips) {
  const QuarantineRecord record = example(), back = decode_quarantine_record(encode(record), "memory");
  EXPECT_EQ(encode(back), encode(record));
  EXPECT_EQ(back.report.fault, record.report.fault);
  EXPECT_EQ(back.report.detail, record.report.detail);
  EXPECT_EQ(back.engine, record.engine);
  EXPECT_EQ(back.set_hash, record.set_hash);
  EXPECT_EQ(back.seed, record.seed);
  EXPECT_EQ(back.episode_index, record.episode_index);
  EXPECT_EQ(back.env, record.env);
  EXPECT_EQ(back.episode_count, record.episode_count);
  EXPECT_EQ(back.step, record.step);
  EXPECT_EQ(back.actions, record.actions);
  EXPECT_EQ(back.episode.start_position, record.episode.start_position);
  EXPECT_EQ(back.config, record.config);
}

TEST(QuarantineRecord, DamagedFilesAreRefused) {
  const std::string text = encode(example());
  const auto load = [](const std::string& bytes) { return decode_quarantine_record(bytes, "file.json"); };
  for (const std::string& bytes : {std::string(), std::string("{}"), std::string("[]"), std::string("3"), std::string(1 << 20, '[')})
    EXPECT_THROW(load(bytes), InputError);
  for (std::size_t size = 0; size + 2 < text.size(); size += 13) EXPECT_THROW(load(text.substr(0, size)), InputError);
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string other = text;
    const auto at = other.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return other.replace(at, from.size(), to);
  };
  EXPECT_THROW(load(with("\"1231\"", "\"1931\"")), InputError);        // an action that does not exist
  EXPECT_THROW(load(with("\"step\": 4", "\"step\": 5")), InputError);  // more steps than actions
  EXPECT_THROW(load(with("\"earshot_quarantine\": 1", "\"earshot_quarantine\": 2")), InputError);
  EXPECT_THROW(load(with("\"sound\",", "\"noise\",")), InputError);  // no such reason
  EXPECT_THROW(load(with("\"env\": 12", "\"env\": -1")), InputError);
  EXPECT_THROW(load(with("fedcba9876543210", "hello")), InputError);
  // Random damage: an error or a record, never another exception.
  for (std::size_t at = 0; at < text.size(); at += 3) {
    std::string other = text;
    other[at] = static_cast<char>(other[at] ^ (1 << (at % 7)));
    try {
      load(other);
    } catch (const InputError&) {
    }
  }
}

TEST(QuarantineRecord, ConfigTextGivesTheSameConfig) {
  EnvConfig config = quick_env_config();
  config.acoustics = acoustic_preset("high");
  config.acoustics.rir_length_s = 0.333333f;
  config.acoustics.field = Switch::off;
  config.observation.camera.width_px = 24;
  config.task.step_reward = -0.0123456789f;
  config.crossfade_s = 0.01f;
  config.order = EpisodeOrder::once;
  config.field_store = "a folder: with #signs";
  config.seed = 18446744073709551615u;
  EnvConfig back;
  ConfigReader reader = ConfigReader::from_text(config_text(config), "memory");
  read(reader, back);
  reader.finish();
  EXPECT_EQ(config_text(back), config_text(config));
  EXPECT_EQ(back.acoustics.rays, config.acoustics.rays);
  EXPECT_EQ(back.acoustics.rir_length_s, config.acoustics.rir_length_s);
  EXPECT_EQ(back.acoustics.field, Switch::off);
  EXPECT_EQ(back.acoustics.threads, config.acoustics.threads);
  EXPECT_EQ(back.task.step_reward, config.task.step_reward);
  EXPECT_EQ(back.order, EpisodeOrder::once);
  EXPECT_EQ(back.field_store, config.field_store);
  EXPECT_EQ(back.seed, config.seed);
  EXPECT_EQ(back.observation.camera.width_px, 24);
}

TEST(Quarantine, AFolderThatCannotBeWrittenEndsNothing) {
  const TestFolder folder("quarantine_folder");
  write_text(folder.path() / "file", "not a folder");
  Quarantine quarantine(folder.path() / "file" / "below");
  for (int i = 0; i < 3; ++i) {
    QuarantineRecord record = example();
    record.env = i;
    EXPECT_NO_THROW(quarantine.add(record));
  }
  EXPECT_EQ(quarantine.counters().of(Fault::sound), 3u);
  EXPECT_EQ(quarantine.counters().files_failed, 3u);
  EXPECT_EQ(quarantine.counters().files_written, 0u);
}

TEST(Quarantine, FilesAreBoundedAndOnePerFault) {
  const TestFolder folder("quarantine_bound");
  Quarantine quarantine(folder.path() / "made", 4);
  for (int i = 0; i < 6; ++i)
    for (int again = 0; again < 2; ++again) {
      QuarantineRecord record = example();
      record.env = i;
      quarantine.add(record);
    }
  const QuarantineCounters counters = quarantine.counters();
  EXPECT_EQ(counters.total(), 12u);
  EXPECT_EQ(counters.files_written, 4u);
  EXPECT_EQ(counters.files_left_out, 8u);
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder.path() / "made")) {
    ++files;
    EXPECT_EQ(entry.path().extension(), ".json");  // no temporary stays
    EXPECT_NO_THROW(load_quarantine_record(entry.path()));
  }
  EXPECT_EQ(files, 4);
}

// A sound that no float can hold once it is convolved: a file with samples near the largest float, met in the middle of an episode.
class X_SoundTooLoud : public testing::Test {
 protected:
  static constexpr std::size_t kSamples = 96000;
  X_SoundTooLoud() : folder_("too_loud"), sound_(folder_.path() / "loud.wav") {
    config_.task.max_steps = 60;
    config_.order = EpisodeOrder::once;
    config_.quarantine_dir = (folder_.path() / "quarantine").string();
    config_.observation.pointgoal = false;
    set_ = make_set({room_episode("shoebox:6x3x5@0.3", {1, 0, 1}, 0, {4, 0, 3}, sound_.string()),
                     room_episode("shoebox:6x3x5@0.3", {1, 0, 1}, 0, {4, 0, 3}, "synth:noise")});
  }
  /// peak: of the samples that are heard in the eighth step of env 0.
  void write_sound(float peak) const {
    std::vector<float> samples(kSamples, 1e-3f);
    const std::uint32_t start = RandomStream(config_.seed, Purpose::sound, 0, 0).below(kSamples, 0);
    const std::size_t heard = start + 16000 + 7 * 2400 + 1000;  // the first second is heard before the first step
    for (std::size_t i = 0; i < 400; ++i) samples[(heard + i) % kSamples] = (i % 2 == 0 ? peak : -peak);
    write_wav(sound_, samples, 1, 16000.f);
  }
  EnvConfig config_ = quick_env_config();
  TestFolder folder_;
  std::filesystem::path sound_;
  std::shared_ptr<const EpisodeSet> set_;
};

TEST_F(X_SoundTooLoud, IsQuarantinedWithAFileThatReplaysIt) {
  write_sound(3e38f);
  BatchedEnv env(config_, set_, make_scene_cache(config_), 1);
  env.reset();
  int steps = 0;
  while (env.quarantined()[0] == 0 && steps < 60) {
    ASSERT_TRUE(buffers_are_finite(env)) << steps;
    env.step(std::vector<std::int32_t>{steps % 2 == 0 ? 2 : 1});
    ++steps;
  }
  EXPECT_EQ(steps, 8);
  ASSERT_EQ(env.quarantined()[0], 1);
  EXPECT_EQ(env.rewards()[0], 0.f);
  EXPECT_TRUE(buffers_are_finite(env));
  EXPECT_EQ(env.agent(0).episode_index, 1u);
  for (int i = 0; i < 10; ++i) {
    env.step(std::vector<std::int32_t>{2});
    ASSERT_TRUE(buffers_are_finite(env)) << i;
    ASSERT_EQ(env.quarantined()[0], 0);
  }
  ASSERT_EQ(env.quarantine_counters().total(), 1u);
  ASSERT_EQ(env.quarantine_counters().files_written, 1u);

  const auto file = std::filesystem::directory_iterator(folder_.path() / "quarantine")->path();
  const QuarantineRecord record = load_quarantine_record(file);
  EXPECT_EQ(record.step, 8);
  EXPECT_EQ(record.actions, (std::vector<std::int8_t>{2, 1, 2, 1, 2, 1, 2, 1}));
  EXPECT_EQ(record.seed, config_.seed);
  EXPECT_EQ(record.env, 0);
  const ReplayOutcome again = replay(record);
  EXPECT_TRUE(again.recurs) << (again.fault ? again.fault->detail : "no fault") << " at " << again.step;
  EXPECT_TRUE(again.same_engine);
  write_sound(0.5f);
  const ReplayOutcome outcome = replay(record);
  EXPECT_FALSE(outcome.recurs);
  EXPECT_FALSE(outcome.fault);
  EXPECT_EQ(outcome.step, 8);
  std::filesystem::remove(sound_);
  EXPECT_THROW(replay(record), InputError);
}

// The same fault found by another env of another worker: the env's id and count decide where the sound begins, so both are replayed.
TEST_F(X_SoundTooLoud, ReplaysTheEnvsOwnPlaceInTheSound) {
  write_sound(3e38f);
  config_.order = EpisodeOrder::random;
  config_.task.max_steps = 12;
  BatchedEnv env(config_, set_, make_scene_cache(config_), 2, 5, 9);
  env.reset();
  for (int i = 0; i < 150 && env.quarantine_counters().files_written < 3; ++i) env.step(std::vector<std::int32_t>{1, 3});
  ASSERT_GE(env.quarantine_counters().files_written, 3u);
  int later = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder_.path() / "quarantine")) {
    const QuarantineRecord record = load_quarantine_record(entry.path());
    later += record.episode_count > 0 ? 1 : 0;
    EXPECT_TRUE(replay(record).recurs) << entry.path();
  }
  EXPECT_GT(later, 0);
}

}  // namespace
}  // namespace earshot
