// SPDX-License-Identifier: Apache-2.0
// Whole runs of worker processes that lose one in the midst of a held-out evaluation: the others make it again.
#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <memory>

#include "evaluation/results/held_out_evaluation.h"
#include "tests/support/workers/training_run.h"
#include "trainer/run/train_loop.h"

namespace earshot {
namespace {

constexpr int kHeldOutWorld = 3;

/// Ends its process in an evaluation, counted from 1, between two steps of an episode.
class DyingEvaluator : public HeldOutEvaluator {
 public:
  DyingEvaluator(std::unique_ptr<HeldOutEvaluator> inner, int dies_in) : inner_(std::move(inner)), dies_in_(dies_in) {}
  [[nodiscard]] const std::string& identity() const override { return inner_->identity(); }
  [[nodiscard]] std::optional<HeldOutScores> evaluate(const PolicyNetwork& policy, Collective& collective) override {
    if (++evaluations_ == dies_in_) ::raise(SIGKILL);
    return inner_->evaluate(policy, collective);
  }

 private:
  std::unique_ptr<HeldOutEvaluator> inner_;
  int dies_in_, evaluations_ = 0;
};

class HeldOutRun : public TrainingRun {
 protected:
  HeldOutRun() : TrainingRun("checkpoint_every: 2\nkeep: 20\neval_envs: 2\nheld_out: {every_updates: 2, max_fraction: 1}\n") {}
  void SetUp() override {
    WorkerProcesses generator(1, [&](int) {
      const RunConfig run = config({});
      return !generate_data(run.train, run.env).episodes.empty() && !generate_data(run.held_out_data, run.env).episodes.empty();
    });
    generator.expect_all_succeed();
  }
  [[nodiscard]] RunConfig config(std::vector<std::string> overrides) const {
    overrides.push_back("data.held_out.file=" + (folder_.path() / "held_out.json").string());
    overrides.emplace_back("data.held_out.scenes=[\"shoebox:4x3x5@0.2\", \"shoebox:6x3x4.5@0.2\"]");
    overrides.emplace_back("data.held_out.sounds=[\"synth:telephone\"]");
    overrides.emplace_back("data.held_out.episodes_per_scene=4");
    overrides.emplace_back("data.held_out.filter.min_geodesic_m=1");
    overrides.emplace_back("data.held_out.filter.min_ratio=1");
    return config_with(overrides);
  }
};

TEST_F(HeldOutRun, GoesOnWhereAnEvaluationLosesAWorker) {
  for (const int victim : {0, 2}) {
    std::filesystem::remove_all(out());
    const int steps = kEnvsPerWorker * kRolloutSteps * (4 * kHeldOutWorld + 2 * (kHeldOutWorld - 1));
    WorkerProcesses workers(kHeldOutWorld, [&](int rank) {
      const RunConfig run = config({"total_steps=" + std::to_string(steps), "network.on_loss=continue"});
      RingConfig ring = ring_in(folder_, rank, kHeldOutWorld);
      ring.network = run.network;
      ring.heartbeat = std::chrono::milliseconds(150);
      const auto collective = make_zmq_ring(ring);
      DyingEvaluator evaluator(make_held_out_evaluator(run), rank == victim ? 2 : 0);
      const TrainReport report = train(run, *collective, {}, {.held_out = &evaluator});
      return report.updates == 6 && report.guards.lost_workers == 1 && report.held_out.evaluations == 3 && report.held_out.last_update == 6;
    });
    for (int rank = 0; rank < kHeldOutWorld; ++rank) {
      const int status = workers.wait(rank);
      EXPECT_TRUE(rank == victim ? WTERMSIG(status) == SIGKILL : status == 0) << rank << " without " << victim;
    }
    std::vector<std::uint64_t> updates, evaluations;
    for (const CurvePoint& point : read_event_log(out() / "events.jsonl"))
      (is_of_held_out(point) ? evaluations : updates).push_back(point.update);
    EXPECT_EQ(updates, (std::vector<std::uint64_t>{1, 2, 3, 4, 5, 6}));
    EXPECT_EQ(evaluations, (std::vector<std::uint64_t>{2, 4, 6})) << "that of update 4 was made again";
    const HeldOutState state = load_checkpoint(out() / "checkpoints/last.ckpt").held_out.value_or(HeldOutState{});
    EXPECT_EQ(load_checkpoint_metadata(out() / "checkpoints/best.ckpt").update, state.best_update);
  }
}

}  // namespace
}  // namespace earshot
