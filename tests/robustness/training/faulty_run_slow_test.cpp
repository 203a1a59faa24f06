// Whole runs of three worker processes: env, policy, learner, collective, files.  Faults come in where the product has seams for tests: the
// hook of the environment, and a collective that damages what passes.
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <atomic>
#include <csignal>
#include <fstream>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "tests/support/fault_bench.h"
#include "trainer/checkpoint.h"
#include "trainer/episode_data.h"
#include "trainer/event_log.h"
#include "trainer/train_loop.h"

namespace earshot::faults {
namespace {

constexpr int kEnvsPerWorker = 2, kRolloutSteps = 8;

std::string tiny_yaml(const std::filesystem::path& folder) {
  return "name: tiny\nseed: 3\nworkers: 3\nenvs_per_worker: 2\nrollout_steps: 8\ncheckpoint_every: 2\nout: " + (folder / "run").string() +
         "\nenv:\n  task: {max_steps: 12}\n  observation: {camera: {width_px: 40, height_px: 40}}\n  acoustics: {rays: 4, rir_length_s: "
         "0.1, early_order: 1}\n"
         "policy: {hidden_size: 16, visual_features: 16, audio_features: 16, conv_channels: 4}\n"
         "ppo: {learning_rate: 1.0e-3, epochs: 2, minibatches: 2}\n"
         "data:\n  train: {file: " +
         (folder / "train.json.gz").string() +
         ", scenes: [\"shoebox:5x3x4@0.2\"], episodes_per_scene: 12, sounds: [\"synth:telephone\"], filter: {min_geodesic_m: 1, min_ratio: "
         "1}}\n";
}

/// Passes all on, and lets a test damage the floats, which are gradients.
class DamagingCollective : public Collective {
 public:
  using Damage = std::function<void(int call, std::span<float> buffer)>;
  DamagingCollective(std::unique_ptr<Collective> inner, Damage before, Damage after)
      : inner_(std::move(inner)), before_(std::move(before)), after_(std::move(after)) {}
  [[nodiscard]] WorkerIdentity identity() const override { return inner_->identity(); }
  void all_reduce_sum(std::span<float> buffer) override {
    if (before_) before_(calls_, buffer);
    inner_->all_reduce_sum(buffer);
    if (after_) after_(calls_, buffer);
    ++calls_;
  }
  void all_reduce_sum(std::span<double> buffer) override { inner_->all_reduce_sum(buffer); }
  void broadcast(std::span<std::byte> buffer) override { inner_->broadcast(buffer); }
  void barrier() override { inner_->barrier(); }
  std::vector<std::string> all_gather(const std::string& bytes) override { return inner_->all_gather(bytes); }

 private:
  std::unique_ptr<Collective> inner_;
  Damage before_, after_;
  int calls_ = 0;
};

class FaultyRun : public testing::Test {
 protected:
  void SetUp() override {
    yaml_ = tiny_yaml(folder_.path());
    // In a process of its own: what forks workers must not have started the threads of the simulation.
    WorkerProcesses generator(1, [&](int) {
      const RunConfig config = parse_run_config(yaml_, "tiny", {});
      return !generate_data(config.train, config.env).episodes.empty();
    });
    generator.expect_all_succeed();
  }

  struct Faults {
    std::function<void(int rank, const StageOutput&, std::span<float>)> env;
    std::function<void(int rank, int call, std::span<float>)> before, after;
  };
  /// This worker's part of a run of `updates` updates.
  TrainReport run(int rank, int updates, const Faults& faults, const std::filesystem::path& resume = {}) {
    const RunConfig config =
        parse_run_config(yaml_, "tiny", {"total_steps=" + std::to_string(updates * kWorkers * kEnvsPerWorker * kRolloutSteps)});
    const auto bind = [rank](const auto& damage) {
      return damage ? DamagingCollective::Damage([rank, damage](int call, std::span<float> buffer) { damage(rank, call, buffer); })
                    : DamagingCollective::Damage();
    };
    DamagingCollective collective(make_zmq_ring(ring_in(folder_, rank, kWorkers)), bind(faults.before), bind(faults.after));
    TrainHooks hooks;
    if (faults.env) hooks.stage_hook = [&, rank](const StageOutput& output, std::span<float> values) { faults.env(rank, output, values); };
    return train(config, collective, {.resume = resume}, hooks);
  }
  [[nodiscard]] std::filesystem::path out() const { return folder_.path() / "run"; }
  double last_value(const std::string& name) {
    const CurvePoint point = read_event_log(out() / "events.jsonl").back();
    for (const auto& [key, value] : point.values)
      if (key == name) return value;
    ADD_FAILURE() << "no curve " << name;
    return -1;
  }

  PrivateTestFolder folder_;
  std::string yaml_;
};

// A NaN from the ear of one env of each worker, and a gradient message damaged at each worker: counted, named, left out; the run ends well,
// and its weights can be resumed from.
TEST_F(FaultyRun, GoesOnToItsEnd) {
  Faults faults;
  SharedArray<std::atomic<int>, kWorkers> poisoned;
  faults.env = [&](int rank, const StageOutput& output, std::span<float> values) {
    if (output.kind == Fault::sound && output.env == rank * kEnvsPerWorker && output.step == 3 &&
        poisoned[static_cast<std::size_t>(rank)].exchange(1) == 0)
      values[0] = kNan;
  };
  faults.after = [](int rank, int call, std::span<float> buffer) {
    if (call == 4 + rank) buffer[7] = kInfinity;
  };
  WorkerProcesses workers(kWorkers, [&](int rank) {
    const TrainReport report = run(rank, 4, faults);
    return report.updates == 4 && report.guards.skipped_steps == kWorkers && report.guards.taken_steps == 4 * 4 - kWorkers &&
           report.counters[RunCounters::quarantined] == kWorkers && report.counters[RunCounters::not_finite] == kWorkers &&
           report.counters[RunCounters::sanitized_rows] == 0 && report.counters[RunCounters::poses] > 0;
  });
  workers.expect_all_succeed();
  for (std::size_t rank = 0; rank < kWorkers; ++rank) EXPECT_EQ(poisoned[rank], 1);
  EXPECT_EQ(last_value("guards/quarantined"), kWorkers);
  EXPECT_EQ(last_value("guards/skipped_steps"), kWorkers);
  EXPECT_EQ(last_value("guards/sanitized_rows"), 0);
  EXPECT_EQ(last_value("guards/ratio_alarms"), 0);
  EXPECT_GE(last_value("hearing/cached"), 0);
  // Each quarantined episode left its file.
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(out() / "quarantine"), {}), kWorkers);

  WorkerProcesses resumed(kWorkers, [&](int rank) {
    const TrainReport report = run(rank, 6, {}, out() / "checkpoints/last.ckpt");
    return report.updates == 6 && report.guards.skipped_steps == 0 && report.guards.taken_steps == 8;
  });
  resumed.expect_all_succeed();
}

// Weights of which every step fails teach nothing: the run says so and ends, and its last checkpoint is of the last good weights.
TEST_F(FaultyRun, ThatTakesNoStepIsEnded) {
  Faults faults;
  faults.before = [](int rank, int, std::span<float> buffer) {
    if (rank == kMiddle) buffer[0] = kNan;
  };
  SharedArray<std::atomic<int>, 1> reasons;
  WorkerProcesses workers(kWorkers, [&](int rank) {
    try {
      run(rank, 100, faults);
    } catch (const RunError& error) {
      // Whoever says so first stops the others, which may still be on their way to say the same.
      const std::string what = error.what();
      const bool own = what.find("20 updates in a row took no step") != std::string::npos;
      reasons[0] += own;
      return own || what.find("stopped the run") != std::string::npos;
    }
    return false;
  });
  workers.expect_all_succeed();
  EXPECT_GE(reasons[0], 1);
  EXPECT_EQ(load_checkpoint(out() / "checkpoints/last.ckpt").update, 20u);
}

// Killed while all train: the others end with its name within seconds, and the run goes on from the last checkpoint to the bits of the
// unbroken one.
TEST_F(FaultyRun, KilledWorkerIsNamedAndTheRunResumes) {
  for (const int victim : {kFirst, kMiddle, kLast}) {
    std::filesystem::remove_all(out());
    WorkerProcesses unbroken(kWorkers, [&](int rank) { return run(rank, 6, {}).updates == 6; });
    unbroken.expect_all_succeed();
    const Checkpoint expected = load_checkpoint(out() / "checkpoints/last.ckpt");
    std::filesystem::remove_all(out());

    Faults faults;
    faults.before = [&](int rank, int call, std::span<float>) {
      if (rank == victim && call == 4 * 4 + 1) ::raise(SIGKILL);  // in the fifth update; checkpoints are of the second and fourth
    };
    WorkerProcesses workers(kWorkers, [&](int rank) {
      try {
        run(rank, 6, faults);
      } catch (const RunError& error) {
        return std::string(error.what()).find("worker " + std::to_string(victim)) != std::string::npos;
      }
      return false;
    });
    for (int rank = 0; rank < kWorkers; ++rank) {
      const int status = workers.wait(rank);
      if (rank == victim) {
        EXPECT_EQ(WTERMSIG(status), SIGKILL);
      } else {
        EXPECT_EQ(status, 0) << "worker " << rank << " of the others";
      }
    }
    const std::filesystem::path checkpoint = find_checkpoint(out());
    EXPECT_EQ(checkpoint.filename(), "update_000004.ckpt");
    WorkerProcesses resumed(kWorkers, [&](int rank) { return run(rank, 6, {}, checkpoint).updates == 6; });
    resumed.expect_all_succeed();
    // All but the minutes that it took.
    const Checkpoint last = load_checkpoint(out() / "checkpoints/last.ckpt");
    for (const auto& [name, tensor] : expected.weights) EXPECT_TRUE(torch::equal(tensor, last.weights.at(name))) << name;
    for (const auto& [name, tensor] : expected.optimizer) EXPECT_TRUE(torch::equal(tensor, last.optimizer.at(name))) << name;
    for (std::size_t rank = 0; rank < kWorkers; ++rank) EXPECT_TRUE(torch::equal(expected.hidden.at(rank), last.hidden.at(rank))) << rank;
    EXPECT_EQ(last.env_states, expected.env_states);
    EXPECT_EQ(last.episode_window, expected.episode_window);
  }
}

// The disk is full for a while: periodic checkpoints and curve points fail and are counted, training goes on, and once there is room the
// last checkpoint is written.  The limit on the size of any file stands for the disk.
TEST_F(FaultyRun, GoesOnWithAFullDisk) {
  WorkerProcesses workers(kWorkers, [&](int rank) {
    ::signal(SIGXFSZ, SIG_IGN);
    const auto limit_files = [](rlim_t bytes) {
      const rlimit limit{bytes, RLIM_INFINITY};
      ::setrlimit(RLIMIT_FSIZE, &limit);
    };
    Faults faults;
    faults.before = [&](int, int call, std::span<float>) {
      if (call == 2) limit_files(1);  // in the first update: its curve point, and the checkpoint and picture of the second, do not fit
      if (call == 4 * 3 - 1) limit_files(RLIM_INFINITY);  // there is room again in the third
    };
    const TrainReport report = run(rank, 4, faults);
    return report.updates == 4 && report.guards.failed_writes == (rank == 0 ? 4u : 0u);
  });
  workers.expect_all_succeed();
  EXPECT_EQ(load_checkpoint(out() / "checkpoints/last.ckpt").update, 4u);
  EXPECT_FALSE(std::filesystem::exists(out() / "checkpoints/update_000002.ckpt"));
  EXPECT_EQ(load_checkpoint(out() / "checkpoints/update_000004.ckpt").update, 4u);
  EXPECT_EQ(read_event_log(out() / "events.jsonl").size(), 2u);  // of updates 3 and 4
}

}  // namespace
}  // namespace earshot::faults
