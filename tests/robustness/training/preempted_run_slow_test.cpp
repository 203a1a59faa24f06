// SPDX-License-Identifier: Apache-2.0
// Workers of which one is four times as slow: what preemption does to its rollouts, and to the steps that all make in a second.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <thread>

#include "tests/support/workers/worker_processes.h"
#include "trainer/checkpoint/checkpoint.h"
#include "trainer/curves/event_log.h"
#include "trainer/run/episode_data.h"
#include "trainer/run/train_loop.h"

namespace earshot {
namespace {

constexpr int kWorld = 8, kSlow = 5, kRolloutSteps = 64;
constexpr std::chrono::milliseconds kStep(60);  // sleep of a healthy worker in a step: far more than what the step computes
constexpr unsigned kLongest_s = 240;            // of a run, before its workers are killed

std::string tiny_yaml(const std::filesystem::path& folder) {
  return "name: tiny\nseed: 3\nenvs_per_worker: 1\nrollout_steps: 64\ncheckpoint_every: 1000\n"
         "env:\n  task: {max_steps: 12}\n  observation: {depth: false, camera: {width_px: 40, height_px: 40}}\n  acoustics: {rays: 4, "
         "rir_length_s: 0.1, early_order: 0}\n"
         "policy: {hidden_size: 8, visual_features: 8, audio_features: 8, conv_channels: 2}\n"
         "ppo: {epochs: 2, minibatches: 1}\n"
         "data:\n  train: {file: " +
         (folder / "train.json.gz").string() +
         ", scenes: [\"shoebox:5x3x4@0.2\"], episodes_per_scene: 12, sounds: [\"synth:telephone\"], filter: {min_geodesic_m: 1, min_ratio: "
         "1}}\n";
}

class PreemptedRun : public testing::Test {
 protected:
  void SetUp() override {
    WorkerProcesses generator(1, [&](int) {
      const RunConfig config = parse_run_config(tiny_yaml(folder_.path()), "tiny", {});
      return !generate_data(config.train, config.env).episodes.empty();
    });
    generator.expect_all_succeed();
  }
  /// Curve points of a run with so much sleep in the steps of one worker.
  std::vector<CurvePoint> run(const std::string& name, int updates, std::chrono::milliseconds slow_step, const std::string& fraction) {
    WorkerProcesses workers(kWorld, [&](int rank) {
      ::alarm(kLongest_s);
      if (std::freopen("/dev/null", "w", stderr) == nullptr) return false;  // a line per update
      RunConfig config = parse_run_config(tiny_yaml(folder_.path()), "tiny",
                                          {"out=" + (folder_.path() / name).string(), "ppo.preempt_fraction=" + fraction,
                                           "total_steps=" + std::to_string(updates * kWorld * kRolloutSteps)});
      RingConfig ring = ring_in(folder_, rank, kWorld);
      ring.rendezvous = "ipc://" + (folder_.path() / ("meet_" + name)).string();
      const auto collective = make_zmq_ring(ring);
      TrainHooks hooks;
      hooks.stage_hook = [&](const StageOutput& output, std::span<float>) {
        if (output.kind == Fault::sound) std::this_thread::sleep_for(rank == kSlow ? slow_step : kStep);
      };
      const TrainReport report = train(config, *collective, {}, hooks);
      return report.env_steps >= config.total_steps && report.guards.skipped_steps == 0;  // weights are compared with the last checkpoint
    });
    workers.expect_all_succeed();
    return read_event_log(folder_.path() / name / "events.jsonl");
  }
  static double value(const CurvePoint& point, const std::string& curve) {
    for (const auto& [name, number] : point.values)
      if (name == curve) return number;
    ADD_FAILURE() << "no curve " << curve;
    return std::nan("");
  }
  static double of_worker(const CurvePoint& point, int rank, const std::string& curve) {
    return value(point, "workers/" + std::to_string(rank) + "/" + curve);
  }
  /// Seconds until enough of the healthy workers (three in five of eight) had their rollouts.
  static double enough_s(const CurvePoint& point) {
    std::vector<double> seconds;
    for (int rank = 0; rank < kWorld; ++rank)
      if (rank != kSlow) seconds.push_back(of_worker(point, rank, "collect_s"));
    std::ranges::sort(seconds);
    return seconds[4];
  }
  /// Steps per second after the first update, which loads the scene.
  static double rate(const std::vector<CurvePoint>& points) {
    return static_cast<double>(points.back().env_steps - points.front().env_steps) / (points.back().wall_s - points.front().wall_s);
  }

  PrivateTestFolder folder_;
};

TEST_F(PreemptedRun, ASlowWorkerMakesShorterRolloutsAndHoldsUpNoOther) {
  const auto healthy = run("healthy", 5, kStep, "0.6"), waiting = run("waiting", 3, 4 * kStep, "0"),
             preempted = run("preempted", 5, 4 * kStep, "0.6");
  std::printf("steps per second: %.1f healthy, %.1f (%.0f %%) with a slow worker, %.1f (%.0f %%) with preemption\n", rate(healthy),
              rate(waiting), 100 * rate(waiting) / rate(healthy), rate(preempted), 100 * rate(preempted) / rate(healthy));
  std::uint64_t before = 0;
  for (const CurvePoint& point : preempted) {
    double steps = 0;
    for (int rank = 0; rank < kWorld; ++rank) {
      const double own_steps = of_worker(point, rank, "rollout_steps");
      EXPECT_GE(own_steps, kRolloutSteps / 4) << rank;
      EXPECT_LE(own_steps, kRolloutSteps) << rank;
      steps += own_steps;
    }
    const double slow_steps = of_worker(point, kSlow, "rollout_steps"), slow_s = of_worker(point, kSlow, "collect_s");
    EXPECT_LT(slow_steps, kRolloutSteps) << "update " << point.update;
    // It ends after the step that is under way when enough others wait: that step, as long as its others were, is all that it holds up.
    EXPECT_LT(slow_s, enough_s(point) + 1.5 * slow_s / slow_steps) << "update " << point.update;
    EXPECT_EQ(static_cast<double>(point.env_steps - before), steps);
    before = point.env_steps;
  }
  for (const CurvePoint& point : waiting) {
    EXPECT_EQ(of_worker(point, kSlow, "rollout_steps"), kRolloutSteps);
    EXPECT_GT(of_worker(point, kSlow, "collect_s"), 2 * enough_s(point));  // four times on an idle machine
  }
  EXPECT_GT(rate(preempted), 1.5 * rate(waiting));  // 3.6 times on an idle machine
  // Where no one is held up, updates take as long as healthy ones, and give as many steps less as the log says.  Waiting alone gives 0.27.
  // The runs are made one after the other and sleep most of the time; a fifth is for the rest, which takes longer where a machine is busy.
  const double steps = static_cast<double>(preempted.back().env_steps - preempted.front().env_steps) /
                       static_cast<double>(healthy.back().env_steps - healthy.front().env_steps);
  const double updates = static_cast<double>(preempted.size() - 1) / static_cast<double>(healthy.size() - 1);
  EXPECT_GT(rate(preempted), 0.8 * steps / updates * rate(healthy));
}

}  // namespace
}  // namespace earshot
