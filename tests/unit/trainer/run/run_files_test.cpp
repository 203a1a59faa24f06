// SPDX-License-Identifier: Apache-2.0
#include "trainer/run/run_files.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cerrno>
#include <cmath>
#include <system_error>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "tests/support/error_message.h"
#include "tests/support/workers/worker_processes.h"
#include "trainer/checkpoint/run_folder.h"
#include "trainer/run/resource_need.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;

/// A disk that holds so many checkpoints, of the files that are really there.
class SmallDisk : public testing::Test {
 protected:
  SmallDisk() { config_.out = folder_.path(); }
  [[nodiscard]] RunFiles files(std::chrono::milliseconds patience = std::chrono::milliseconds(300)) {
    return RunFiles(config_, 0, {patience, std::chrono::milliseconds(20)}, [this](const Checkpoint& checkpoint, const auto& file) {
      ++tries_;
      std::size_t held = 0;
      for (const auto& other : RunFolder(config_.out).checkpoints()) held += other.filename() == "best.ckpt" ? 0 : 1;
      if (held >= room_) throw RunError(file.string(), "cannot be written: " + std::generic_category().message(error_));
      save_checkpoint(checkpoint, file);
    });
  }
  static Checkpoint of(std::uint64_t update) {
    Checkpoint checkpoint;
    checkpoint.update = update;
    checkpoint.mean_reward = std::nan("");
    return checkpoint;
  }
  [[nodiscard]] std::vector<std::string> names() const {
    std::vector<std::string> names;
    for (const auto& file : RunFolder(config_.out).checkpoints()) names.push_back(file.filename());
    return names;
  }

  PrivateTestFolder folder_;
  RunConfig config_;
  std::size_t room_ = 100;
  int error_ = ENOSPC, tries_ = 0;
};

TEST_F(SmallDisk, OlderCheckpointsMakeRoomAndTheNewestStays) {
  RunFiles files = this->files();
  for (std::uint64_t update : {1, 2, 3}) EXPECT_EQ(files.save(of(update), false), 0u);
  EXPECT_EQ(files.finish(), 0u);
  EXPECT_EQ(names().size(), 3u);
  room_ = 2;
  EXPECT_EQ(files.save(of(4), false), 0u);
  EXPECT_EQ(files.finish(), 0u);
  EXPECT_THAT(names(), testing::ElementsAre("update_000003.ckpt", "update_000004.ckpt"));
  EXPECT_EQ(files.saved_update(), 4u);
  // One alone is never given away for one that may not come.
  room_ = 0;
  EXPECT_EQ(files.save(of(5), false), 0u);
  EXPECT_GE(files.finish(), 1u);
  EXPECT_THAT(names(), testing::ElementsAre("update_000004.ckpt"));
  EXPECT_EQ(files.saved_update(), 4u);
  EXPECT_TRUE(files.owes_checkpoint());
  room_ = 100;
  EXPECT_EQ(files.save(of(6), false), 0u);
  EXPECT_EQ(files.finish(), 0u);
  EXPECT_FALSE(files.owes_checkpoint());
}

TEST_F(SmallDisk, ADamagedNewestIsNoReasonToDropAnother) {
  RunFiles files = this->files();
  EXPECT_EQ(files.save(of(1), false), 0u);
  EXPECT_EQ(files.finish(), 0u);
  write_file_atomically(files.checkpoint_of(2, false), "EARSHOT, but cut off");
  room_ = 2;
  EXPECT_EQ(files.save(of(3), false), 0u);
  EXPECT_GE(files.finish(), 1u);
  EXPECT_THAT(names(), testing::Contains("update_000001.ckpt"));
}

// Only a full disk is a reason to remove files.
TEST_F(SmallDisk, OnlyAFullDiskCostsCheckpoints) {
  RunFiles files = this->files();
  for (std::uint64_t update : {1, 2}) EXPECT_EQ(files.save(of(update), false), 0u);
  EXPECT_EQ(files.finish(), 0u);
  room_ = 0;
  error_ = EIO;
  EXPECT_EQ(files.save(of(3), false), 0u);
  EXPECT_GE(files.finish(), 1u);
  EXPECT_EQ(names().size(), 2u);
}

TEST_F(SmallDisk, TheLastOneWaitsForRoom) {
  RunFiles files = this->files();
  EXPECT_EQ(files.save(of(1), false), 0u);
  EXPECT_EQ(files.finish(), 0u);
  room_ = 1;
  int waits = 0;
  EXPECT_EQ(files.save(of(2), true,
                       [&] {
                         if (++waits == 3) room_ = 2;
                       }),
            0u);
  EXPECT_EQ(waits, 3);
  EXPECT_EQ(load_checkpoint(files.checkpoint_of(2, true)).update, 2u);
  // Not for ever; what was saved stays.
  room_ = 0;
  EXPECT_THAT(error_message([&] { static_cast<void>(files.save(of(3), true, {})); }), HasSubstr("cannot be written"));
  EXPECT_EQ(load_checkpoint_metadata(find_checkpoint(folder_.path())).update, 2u);
}

// The text file holds the last update and the last evaluation, whichever came later.
TEST(RunFilesMetrics, AnEvaluationStaysBesideLaterUpdates) {
  const PrivateTestFolder folder;
  RunConfig config;
  config.out = folder.path() / "run";
  config.metrics_file = folder.path() / "metrics.prom";
  RunFiles files(config, 0);
  const auto text_after = [&](const CurvePoint& point) {
    EXPECT_EQ(files.write_point(point), 0u);
    return read_file(config.metrics_file);
  };
  EXPECT_THAT(text_after({1, 10, 1, {{"episodes/success", 0.5}}}), testing::Not(HasSubstr("held_out")));
  EXPECT_THAT(
      text_after({1, 10, 2, {{"held_out/argmax_success", 0.25}}}),
      AllOf(HasSubstr("earshot_episodes_success{run=\"run\"} 0.5"), HasSubstr("earshot_held_out_argmax_success{run=\"run\"} 0.25")));
  EXPECT_THAT(text_after({2, 20, 3, {{"episodes/success", 0.75}}}),
              AllOf(HasSubstr("earshot_update_total{run=\"run\"} 2"), HasSubstr("success{run=\"run\"} 0.75"), HasSubstr(" 0.25\n")));
}

RunConfig config_of(const std::vector<std::string>& overrides) { return parse_run_config("seed: 1", "a.yaml", overrides); }

// The rollout's share by hand: depth of 128 x 128 floats, two spectrograms of 65 x 26, 2 x 4 x 10 numbers, for each row.
TEST(ResourceNeed, GrowsWithWhatIsAskedFor) {
  const ResourceNeed need = resource_need(
      config_of({"envs_per_worker=4", "rollout_steps=100", "env.observation.camera.width_px=128", "env.observation.camera.height_px=128"}),
      3);
  const double least = 4.0 * 100 * (128 * 128 * 4 + 65 * 26 * 2 * 4);
  EXPECT_GE(need.rollout_bytes, least);
  EXPECT_LT(need.rollout_bytes, 1.1 * least);
  EXPECT_DOUBLE_EQ(need.bytes(), 3 * need.worker_bytes());
}

// Two seconds of a response and a quarter of a second of a step, for each channel.
TEST(ResourceNeed, CountsTheChannelsOfTheSound) {
  const auto bytes = [](const std::string& channels) {
    return resource_need(config_of({"envs_per_worker=1", "env.observation.spectrogram=false", "env.observation.waveform=true",
                                    "env.acoustics.rir_length_s=2", "env.observation.channels=" + channels}),
                         1)
        .environment_bytes;
  };
  const double rate = config_of({}).env.acoustics.sample_rate_hz;
  for (const auto& [channels, count] : {std::pair("mono", 1), {"quad", 4}, {"surround_7_1", 8}, {"ambisonic:4", 25}}) {
    const double sound = (count - 2) * (2 + 0.25) * rate * sizeof(float);  // the response and the sound of a step
    EXPECT_NEAR(bytes(channels) - bytes("binaural"), sound, 1e-6 * std::abs(sound)) << channels;
  }
}

TEST(ResourceNeed, IsRefusedBeyondTheMachine) {
  const MachineLimits machine{.memory_bytes = std::uint64_t{16} << 30, .cores = 2};
  const auto refusal = [&](const std::vector<std::string>& overrides, int processes, const MachineLimits& limits) {
    return error_message([&] { refuse_beyond_machine(config_of(overrides), processes, limits); });
  };
  EXPECT_EQ(refusal({}, 4, machine), "no error");
  EXPECT_EQ(refusal({}, 32, machine), "no error");
  EXPECT_THAT(refusal({}, 33, machine), AllOf(HasSubstr("33 workers: are more"), HasSubstr("2 cores")));
  EXPECT_THAT(refusal({"rollout_steps=2000000000"}, 1, machine), AllOf(HasSubstr("rollout_steps = 2000000000"), HasSubstr("17.2 GB")));
  EXPECT_THAT(refusal({"envs_per_worker=100000000", "rollout_steps=1"}, 1, machine), HasSubstr("envs_per_worker = 100000000"));
  EXPECT_THAT(refusal({"policy.hidden_size=8192"}, 8, machine), HasSubstr("policy.hidden_size = 8192"));
  EXPECT_THAT(refusal({}, 1, {.memory_bytes = 0, .process_bytes = 50'000'000, .cores = 2}), HasSubstr("the limit (ulimit -v) is 50 MB"));
  EXPECT_EQ(refusal({}, 1, {.memory_bytes = 0, .cores = 1}), "no error");
  const MachineLimits limits = machine_limits();
  EXPECT_GT(limits.memory_bytes, std::uint64_t{1} << 28);
  EXPECT_GE(limits.cores, 1);
}

}  // namespace
}  // namespace earshot
