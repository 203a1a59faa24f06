// SPDX-License-Identifier: Apache-2.0
#include "trainer/run/start_run.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <thread>

#include "envs/batch/env_state.h"
#include "evaluation/results/result.h"
#include "sim/base/engine_hash.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "tests/support/workers/two_workers.h"
#include "tests/support/workers/worker_processes.h"
#include "trainer/checkpoint/checkpoint.h"
#include "trainer/run/episode_data.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;

class StartRun : public testing::Test {
 protected:
  StartRun() { write_set(); }

  [[nodiscard]] std::string path(const std::string& name) const { return (folder_.path() / name).string(); }
  [[nodiscard]] RunConfig config(std::vector<std::string> overrides = {}) const {
    overrides.insert(overrides.begin(), {"out=" + path("run"), "data.train.file=" + path("train.json"), "data.train.scenes=[house:1]",
                                         "data.train.sounds=[synth:noise]"});
    return parse_run_config("seed: 3", "run.yaml", overrides);
  }
  /// One episode that says it was made from the config's keys.
  void write_set(const std::vector<std::string>& overrides = {}) {
    Episode episode;
    episode.episode_id = "0";
    episode.scene_id = "house:1";
    episode.geodesic_distance_m = 3;
    episode.num_action = 20;
    episode.sound = "synth:noise";
    const RunConfig made_from = config(overrides);
    EpisodeSet set{{episode}, 0};
    set.generator = generator_keys(made_from.train, made_from.env);
    save_episode_set(set, made_from.train.file);
  }
  /// A checkpoint of a run of this config and program.
  std::filesystem::path write_checkpoint(const std::string& name, const std::vector<std::string>& overrides = {}) {
    Checkpoint checkpoint;
    checkpoint.config_yaml = config_text(config(overrides));
    checkpoint.engine = engine_;
    checkpoint.engine_commit = "abc";
    if (!is_policy_) {
      EnvState state;
      state.set_hash = load_episode_set(config(overrides).train.file).hash;
      checkpoint.env_states = {has_unknown_states_ ? "of another engine" : encode(state)};
    }
    save_checkpoint(checkpoint, path(name));
    return path(name);
  }
  static std::string refusal(const RunConfig& config, const RunStart& start = {}) {
    try {
      prepare_run(config, start);
    } catch (const InputError& error) {
      return error.what();
    }
    return "starts";
  }

  PrivateTestFolder folder_;
  std::string engine_ = engine_hash();
  bool is_policy_ = false, has_unknown_states_ = false;
};

TEST_F(StartRun, AFolderWithCheckpointsIsRefusedUnlessTold) {
  EXPECT_EQ(refusal(config()), "starts");
  const auto checkpoint = write_checkpoint("run/checkpoints/update_000050.ckpt");
  write_file_atomically(path("run/events.jsonl"), "x");
  write_file_atomically(path("run/notes.txt"), "x");
  EXPECT_THAT(refusal(config()),
              AllOf(HasSubstr(path("run") + ": contains an earlier run"), HasSubstr("--resume"), HasSubstr("--overwrite")));
  EXPECT_THAT(refusal(config(), {.resume = checkpoint, .overwrite = true}), HasSubstr("--overwrite"));
  EXPECT_TRUE(std::filesystem::exists(checkpoint));
  EXPECT_EQ(refusal(config(), {.overwrite = true}), "starts");
  EXPECT_FALSE(std::filesystem::exists(checkpoint));
  EXPECT_FALSE(std::filesystem::exists(path("run/events.jsonl")));
  EXPECT_TRUE(std::filesystem::exists(path("run/notes.txt")));
  EXPECT_EQ(refusal(config()), "starts");
}

// Whatever else is wrong is found before anything is removed.
TEST_F(StartRun, OverwritingWaitsForEveryOtherCheck) {
  const auto checkpoint = write_checkpoint("run/checkpoints/last.ckpt");
  EXPECT_THAT(refusal(config({"data.train.seed=9"}), {.overwrite = true}), HasSubstr("data.seed"));
  EXPECT_TRUE(std::filesystem::exists(checkpoint));
}

TEST_F(StartRun, AResumedRunHasTheConfigOfItsCheckpoint) {
  const auto checkpoint = write_checkpoint("run/checkpoints/last.ckpt");
  EXPECT_EQ(refusal(config(), {.resume = checkpoint}), "starts");
  EXPECT_THAT(refusal(config({"ppo.clip=0.1"}), {.resume = checkpoint}),
              AllOf(HasSubstr("ppo.clip = 0.2"), HasSubstr("has 0.1"), HasSubstr("--change ppo.clip")));
  // Of the environment: the set was made from this key too, so it is made anew for the declared change.
  write_set({"env.task.forward_m=0.25"});
  const RunConfig longer_steps = config({"env.task.forward_m=0.25"});
  EXPECT_THAT(refusal(longer_steps, {.resume = checkpoint}),
              AllOf(HasSubstr("last.ckpt"), HasSubstr("env.task.forward_m = 0.15"), HasSubstr("has 0.25")));
  EXPECT_EQ(refusal(longer_steps, {.resume = checkpoint, .changes = {"env.task.forward_m"}}), "starts");
  EXPECT_EQ(refusal(longer_steps, {.resume = checkpoint, .changes = {"env.task"}}), "starts");
  EXPECT_THAT(refusal(longer_steps, {.resume = checkpoint, .changes = {"env.tas"}}), HasSubstr("did you mean 'env.task'"));
  EXPECT_THAT(refusal(longer_steps, {.changes = {"env.task"}}), HasSubstr("--change"));
}

// A default that the checkpoint never named is bound too: it holds values, not the file.
TEST_F(StartRun, DefaultsAreBoundAsWell) {
  const auto checkpoint = write_checkpoint("run/checkpoints/last.ckpt", {"env.acoustics.preset=fast"});
  EXPECT_EQ(refusal(config({"env.acoustics.preset=fast"}), {.resume = checkpoint}), "starts");
  EXPECT_THAT(refusal(config({"env.acoustics.preset=high"}), {.resume = checkpoint}), HasSubstr("env.acoustics."));
}

TEST_F(StartRun, KeysWithoutAPartInTheBitsMayChange) {
  const auto checkpoint = write_checkpoint("run/checkpoints/last.ckpt");
  EXPECT_EQ(refusal(config({"total_steps=7", "max_minutes=3", "checkpoint_every=2", "keep=9", "workers=5", "env.threads=2", "name=other",
                            "env.field_store=" + path("fields"), "data.eval.seed=5", "ppo.kl_alarm=7", "env.acoustics.threads=2"}),
                    {.resume = checkpoint}),
            "starts");
  EXPECT_EQ(refusal(config({"eval_actions=argmax"}), {.resume = checkpoint}), "starts");
  EXPECT_THAT(refusal(config({"overlap=true"}), {.resume = checkpoint}), HasSubstr("overlap"));
  // Where a schedule depends on them, the bits do.
  for (const std::string key : {"ppo.linear_entropy_decay=true", "guidance.imitation=1", "guidance.imitation_end_weight=0.5"}) {
    const auto scheduled = write_checkpoint("run/checkpoints/last.ckpt", {key});
    EXPECT_THAT(refusal(config({key, "total_steps=7"}), {.resume = scheduled}), HasSubstr("total_steps")) << key;
    EXPECT_EQ(refusal(config({key, "max_minutes=3"}), {.resume = scheduled}), "starts") << key;
  }
  const auto by_minutes = write_checkpoint("run/checkpoints/last.ckpt", {"schedule=minutes", "max_minutes=5"});
  EXPECT_THAT(refusal(config({"schedule=minutes", "max_minutes=3"}), {.resume = by_minutes}), HasSubstr("max_minutes"));
  const auto decaying = write_checkpoint("run/checkpoints/last.ckpt", {"ppo.linear_learning_rate_decay=true"});
  EXPECT_THAT(refusal(config({"ppo.linear_learning_rate_decay=true", "total_steps=7"}), {.resume = decaying}), HasSubstr("total_steps"));
}

TEST_F(StartRun, AnotherEngineIsRefusedUnlessDeclared) {
  engine_ = "0123456789abcdef";
  const auto checkpoint = write_checkpoint("run/checkpoints/last.ckpt");
  EXPECT_THAT(refusal(config(), {.resume = checkpoint}),
              AllOf(HasSubstr("engine 0123456789abcdef (commit abc)"), HasSubstr(engine_hash())));
  EXPECT_EQ(refusal(config(), {.resume = checkpoint, .changes = {"engine"}}), "starts");
  // Before its environments are looked at, which another engine may have written otherwise.
  has_unknown_states_ = true;
  const auto unknown = write_checkpoint("run/checkpoints/last.ckpt");
  EXPECT_THAT(refusal(config(), {.resume = unknown}), HasSubstr("engine 0123456789abcdef"));
}

TEST_F(StartRun, NoRunGoesOnFromAPolicy) {
  is_policy_ = true;
  const auto policy = write_checkpoint("a.policy");
  EXPECT_THAT(refusal(config(), {.resume = policy}), AllOf(HasSubstr("is a policy"), HasSubstr("initial_policy=" + policy.string())));
}

TEST_F(StartRun, AResumedRunDoesNotGoIntoAnotherRunsFolder) {
  const auto checkpoint = write_checkpoint("first/checkpoints/last.ckpt");
  EXPECT_EQ(refusal(config(), {.resume = checkpoint}), "starts");
  write_checkpoint("run/checkpoints/last.ckpt");
  EXPECT_THAT(refusal(config(), {.resume = checkpoint}), AllOf(HasSubstr("contains a different run"), HasSubstr(checkpoint.string())));
}

TEST_F(StartRun, AStaleEpisodeSetIsRefused) {
  const RunStart start{.remake = "earshot dataset episodes --config a.yaml"};
  EXPECT_THAT(refusal(config({"data.train.seed=9"}), start),
              AllOf(HasSubstr("train.json: was made with data.seed = 0, but the config has 9"), HasSubstr(start.remake)));
  EXPECT_THAT(refusal(config({"data.train.episodes_per_scene=9", "data.train.filter.min_ratio=1"}), start),
              AllOf(HasSubstr("data.episodes_per_scene = 50"), HasSubstr("1 more keys differ")));
  EXPECT_THAT(refusal(config({"data.train.scenes=[house:2]"}), start), HasSubstr("data.scenes"));
  EXPECT_THAT(refusal(config({"env.task.forward_m=0.25"}), start), HasSubstr("env.task.forward_m"));
  EXPECT_THAT(refusal(config({"env.navmesh.agent_radius_m=0.3"}), start), HasSubstr("env.navmesh.agent_radius_m"));
  // Keys of the environment that no episode depends on.
  EXPECT_EQ(refusal(config({"env.task.step_reward=0", "env.sound_gain=2", "env.acoustics.rays=10", "ppo.clip=0.1"}), start), "starts");
}

// A set of the AudioNav layout lacks this key: it is used unchanged if the config does not generate one.
TEST_F(StartRun, ASetFromElsewhereIsUsedWhereTheConfigNamesNoScenes) {
  EpisodeSet set = load_episode_set(path("train.json"));
  set.generator.clear();
  save_episode_set(set, path("train.json"));
  EXPECT_THAT(refusal(config()), HasSubstr("does not contain the keys"));
  EXPECT_EQ(refusal(config({"data.train.scenes=[]"})), "starts");
}

// Rank 0 decides, whatever another rank sees of the folder, and all stop.
TEST_F(StartRun, AllWorkersStopWhenRankZeroRefuses) {
  TwoWorkers workers;
  const auto decide = [&](const std::array<RunConfig, 2>& configs) {
    std::array<std::string, 2> outcomes;
    std::vector<std::thread> threads;
    for (int rank = 0; rank < 2; ++rank)
      threads.emplace_back([&, rank] {
        TwoWorkers::Worker worker = workers.worker(rank);
        try {
          prepare_run(configs[static_cast<std::size_t>(rank)], {}, worker);
          outcomes[static_cast<std::size_t>(rank)] = "starts";
        } catch (const InputError& error) {
          outcomes[static_cast<std::size_t>(rank)] = error.what();
        }
      });
    for (std::thread& thread : threads) thread.join();
    return outcomes;
  };
  write_checkpoint("run/checkpoints/last.ckpt");
  const RunConfig free = config({"out=" + path("free")});
  const auto refused = decide({config(), free});
  EXPECT_THAT(refused[0], HasSubstr("contains an earlier run"));
  EXPECT_THAT(refused[1], AllOf(HasSubstr("worker 1"), HasSubstr("contains an earlier run")));
  EXPECT_EQ(decide({free, config()}), (std::array<std::string, 2>{"starts", "starts"}));
}

TEST_F(StartRun, AnElasticStartTakesAnyNumberOfWorkersAndNoOtherChange) {
  EXPECT_EQ(refusal(config(), {.elastic = true}), "starts");
  EXPECT_EQ(newest_checkpoint(config()), "");
  const auto checkpoint = write_checkpoint("run/checkpoints/last.ckpt");
  EXPECT_EQ(newest_checkpoint(config()), checkpoint);
  EXPECT_EQ(refusal(config({"workers=4"}), {.resume = checkpoint, .elastic = true}), "starts");
  EXPECT_THAT(refusal(config({"ppo.clip=0.1"}), {.resume = checkpoint, .elastic = true}), HasSubstr("--change ppo.clip"));
  EXPECT_EQ(refusal(config({"ppo.clip=0.1"}), {.resume = checkpoint, .elastic = true, .changes = {"ppo.clip"}}), "starts");
  EXPECT_THAT(refusal(config(), {.elastic = true, .overwrite = true}), HasSubstr("--elastic"));
  EXPECT_TRUE(std::filesystem::exists(checkpoint));
}

TEST_F(StartRun, TheEndOfARunIsThatOfItsSchedule) {
  CheckpointMetadata saved;
  saved.env_steps = 1000;
  saved.elapsed_s = 90;
  EXPECT_TRUE(has_reached_end(config({"total_steps=1000"}), saved));
  EXPECT_FALSE(has_reached_end(config({"total_steps=1001"}), saved));
  EXPECT_FALSE(has_reached_end(config({"total_steps=1001", "max_minutes=1"}), saved)) << "of one sitting";
  EXPECT_TRUE(has_reached_end(config({"total_steps=1001", "max_minutes=1", "schedule=minutes"}), saved));
  EXPECT_FALSE(has_reached_end(config({"total_steps=1001", "max_minutes=2", "schedule=minutes"}), saved));
}

// Whatever another rank sees of the folder before.
TEST_F(StartRun, AllWorkersTakeTheCheckpointOfRankZero) {
  TwoWorkers workers;
  const auto older = write_checkpoint("other/checkpoints/last.ckpt"), newest = write_checkpoint("run/checkpoints/last.ckpt");
  for (const std::string& first : {path("run"), path("none")}) {
    std::array<std::filesystem::path, 2> taken;
    std::vector<std::thread> threads;
    for (int rank = 0; rank < 2; ++rank)
      threads.emplace_back([&, rank] {
        TwoWorkers::Worker worker = workers.worker(rank);
        const RunStart start{.resume = rank == 0 ? std::filesystem::path() : older, .elastic = true};
        taken[static_cast<std::size_t>(rank)] = prepare_run(config({"out=" + first}), start, worker).resume;
      });
    for (std::thread& thread : threads) thread.join();
    const std::filesystem::path expected = first == path("run") ? newest : std::filesystem::path();
    EXPECT_EQ(taken, (std::array{expected, expected}));
  }
}

}  // namespace
}  // namespace earshot
