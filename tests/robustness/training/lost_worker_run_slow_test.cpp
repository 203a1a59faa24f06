// Whole runs of four worker processes that go on without one of them: what it takes, what the others hold, and what is on disk.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <memory>

#include "sim/base/files.h"
#include "tests/support/worker_processes.h"
#include "trainer/checkpoint.h"
#include "trainer/episode_data.h"
#include "trainer/event_log.h"
#include "trainer/train_loop.h"

namespace earshot {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kWorld = 4, kEnvsPerWorker = 2, kRolloutSteps = 8;
constexpr int kCallsPerUpdate = 4;  // sums of a gradient: two epochs of two minibatches

std::string tiny_yaml(const std::filesystem::path& folder) {
  return "name: tiny\nseed: 3\nenvs_per_worker: 2\nrollout_steps: 8\ncheckpoint_every: 2\nkeep: 20\nout: " + (folder / "run").string() +
         "\nenv:\n  task: {max_steps: 12}\n  observation: {camera: {width_px: 40, height_px: 40}}\n  acoustics: {rays: 4, rir_length_s: "
         "0.1, early_order: 1}\n"
         "policy: {hidden_size: 16, visual_features: 16, audio_features: 16, conv_channels: 4, normalize_values: true}\n"
         "ppo: {learning_rate: 1.0e-3, epochs: 2, minibatches: 2, normalize_advantages: true}\n"
         "data:\n  train: {file: " +
         (folder / "train.json.gz").string() +
         ", scenes: [\"shoebox:5x3x4@0.2\"], episodes_per_scene: 12, sounds: [\"synth:telephone\"], filter: {min_geodesic_m: 1, min_ratio: "
         "1}}\n";
}

/// Passes all on, and tells a test before and after each sum of a gradient.
class WatchedCollective : public Collective {
 public:
  using Watch = std::function<void(int call)>;
  WatchedCollective(std::unique_ptr<Collective> inner, Watch before, Watch after)
      : inner_(std::move(inner)), before_(std::move(before)), after_(std::move(after)) {}
  [[nodiscard]] WorkerIdentity identity() const override { return inner_->identity(); }
  void all_reduce_sum(std::span<float> buffer) override {
    before_(calls_);
    inner_->all_reduce_sum(buffer);
    after_(calls_++);
  }
  void all_reduce_sum(std::span<double> buffer) override { inner_->all_reduce_sum(buffer); }
  void broadcast(std::span<std::byte> buffer) override { inner_->broadcast(buffer); }
  void barrier() override { inner_->barrier(); }
  std::vector<std::string> all_gather(const std::string& bytes) override { return inner_->all_gather(bytes); }
  [[nodiscard]] std::vector<int> members() const override { return inner_->members(); }
  [[nodiscard]] bool survives_loss() const override { return inner_->survives_loss(); }
  void note_progress() override { inner_->note_progress(); }

 private:
  std::unique_ptr<Collective> inner_;
  Watch before_, after_;
  int calls_ = 0;
};

class LostWorkerRun : public testing::Test {
 protected:
  void SetUp() override {
    yaml_ = tiny_yaml(folder_.path());
    WorkerProcesses generator(1, [&](int) {
      const RunConfig config = parse_run_config(yaml_, "tiny", {});
      return !generate_data(config.train, config.env).episodes.empty();
    });
    generator.expect_all_succeed();
  }
  [[nodiscard]] std::filesystem::path out(const std::string& name = "run") const { return folder_.path() / name; }

  /// This worker's part of a run of `world` workers up to so many steps.
  TrainReport run(int rank, int world, int steps, const std::string& name, const RunStart& start, const WatchedCollective::Watch& before,
                  const WatchedCollective::Watch& after) {
    const RunConfig config =
        parse_run_config(yaml_, "tiny", {"total_steps=" + std::to_string(steps), "out=" + out(name).string(), "network.on_loss=continue"});
    RingConfig ring = ring_in(folder_, rank, world);
    ring.network = config.network;
    ring.heartbeat = std::chrono::milliseconds(150);
    WatchedCollective collective(make_zmq_ring(ring), before, after);
    return train(config, collective, start);
  }
  double last_value(const std::string& curve) {
    const CurvePoint point = read_event_log(out() / "events.jsonl").back();
    for (const auto& [key, value] : point.values)
      if (key == curve) return value;
    ADD_FAILURE() << "no curve " << curve;
    return -1;
  }
  static void expect_same_learner(const std::filesystem::path& a, const std::filesystem::path& b) {
    const Checkpoint one = load_checkpoint(a), other = load_checkpoint(b);
    ASSERT_EQ(one.optimizer.size(), other.optimizer.size());
    for (const auto& [name, tensor] : one.weights) EXPECT_TRUE(torch::equal(tensor, other.weights.at(name))) << name;
    for (const auto& [name, tensor] : one.optimizer) EXPECT_TRUE(torch::equal(tensor, other.optimizer.at(name))) << name;
    EXPECT_EQ(one.env_states, other.env_states);
    EXPECT_EQ(one.members, other.members);
  }

  /// The worker gets the signal in its third update; the others make six updates, and what they saved after the loss can be gone on with.
  void expect_others_go_on(int victim, int signal) {
    std::filesystem::remove_all(out());
    std::filesystem::remove_all(out("resumed"));
    const int steps = kEnvsPerWorker * kRolloutSteps * (2 * kWorld + 4 * (kWorld - 1));
    SharedArray<double, kWorld + 1> at;  // when the first sum without the victim was there; the event
    const auto start = Clock::now();
    const auto now = [&] { return std::chrono::duration<double>(Clock::now() - start).count(); };
    WorkerProcesses workers(kWorld, [&](int rank) {
      bool lost = false;
      const auto before = [&](int call) {
        if (rank != victim || call != 2 * kCallsPerUpdate + 1) return;
        at[kWorld] = now();
        ::raise(signal);
      };
      const auto after = [&](int call) {
        if (call > 2 * kCallsPerUpdate && !std::exchange(lost, call > 2 * kCallsPerUpdate)) at[static_cast<std::size_t>(rank)] = now();
      };
      try {
        const TrainReport report = run(rank, kWorld, steps, "run", {}, before, after);
        return rank != victim && report.updates == 6 && report.env_steps == static_cast<std::uint64_t>(steps) &&
               report.guards.lost_workers == 1;
      } catch (const LeftOut& error) {
        std::fprintf(stderr, "%s\n", error.what());
        return rank == victim;
      }
    });
    for (int rank = 0; rank < kWorld; ++rank) {
      if (rank == victim) continue;
      EXPECT_EQ(workers.wait(rank), 0) << "worker " << rank << " without " << victim;
      const double took = at[static_cast<std::size_t>(rank)] - at[kWorld];
      std::printf("worker %d: next sum %.0f ms after worker %d was gone\n", rank, 1000 * took, victim);
      EXPECT_LT(took, 8.0);  // 0.9 s at most on an idle machine
    }
    ::kill(workers.pid(victim), SIGCONT);
    const int status = workers.wait(victim);
    EXPECT_TRUE(signal == SIGKILL ? WTERMSIG(status) == SIGKILL : status == 0) << status;

    EXPECT_EQ(last_value("guards/lost_workers"), 1);
    const auto points = read_event_log(out() / "events.jsonl");
    for (std::size_t i = 1; i < points.size(); ++i) EXPECT_EQ(points[i].update, points[i - 1].update + 1);
    const Checkpoint last = load_checkpoint(out() / "checkpoints/last.ckpt");
    EXPECT_EQ(last.update, 6u);
    EXPECT_EQ(last.world_size, kWorld - 1);
    EXPECT_EQ(last.started_workers, kWorld);
    EXPECT_EQ(std::ranges::count(last.members, victim), 0);

    // Those that are left give the same bits when they are begun anew from the checkpoint of the update after the loss.
    std::filesystem::create_directories(out("resumed"));
    WorkerProcesses resumed(kWorld - 1, [&](int rank) {
      const RunStart from{.resume = out() / "checkpoints/update_000004.ckpt"};
      return run(
                 rank, kWorld - 1, steps, "resumed", from, [](int) {}, [](int) {})
                 .updates == 6;
    });
    resumed.expect_all_succeed();
    expect_same_learner(out("resumed") / "checkpoints/last.ckpt", out() / "checkpoints/last.ckpt");
  }

  PrivateTestFolder folder_;
  std::string yaml_;
};

TEST_F(LostWorkerRun, GoesOnWithoutAKilledOne) {
  for (const int victim : {0, 2, 3}) expect_others_go_on(victim, SIGKILL);
}

TEST_F(LostWorkerRun, GoesOnWithoutAStoppedOne) { expect_others_go_on(1, SIGSTOP); }

// Another number of workers is declared: weights, optimizer and schedule go on, the environments begin anew.
TEST_F(LostWorkerRun, ResumesWithAnotherNumberOfWorkers) {
  const int per_worker = kEnvsPerWorker * kRolloutSteps;
  const auto nothing = [](int) {};
  WorkerProcesses first(2, [&](int rank) { return run(rank, 2, 2 * 2 * per_worker, "run", {}, nothing, nothing).updates == 2; });
  first.expect_all_succeed();
  const std::filesystem::path checkpoint = out() / "checkpoints/last.ckpt";
  WorkerProcesses refused(3, [&](int rank) {
    try {
      run(rank, 3, 10 * per_worker, "three", {.resume = checkpoint}, nothing, nothing);
    } catch (const std::exception& error) {
      return std::string(error.what()).find("worker") != std::string::npos;
    }
    return false;
  });
  refused.expect_all_succeed();
  WorkerProcesses more(3, [&](int rank) {
    const TrainReport report = run(rank, 3, 10 * per_worker, "three", {.resume = checkpoint, .changes = {"workers"}}, nothing, nothing);
    return report.updates == 4 && report.env_steps == 10u * per_worker;
  });
  more.expect_all_succeed();
  const Checkpoint before = load_checkpoint(checkpoint), after = load_checkpoint(out("three") / "checkpoints/last.ckpt");
  EXPECT_EQ(after.world_size, 3);
  EXPECT_EQ(after.env_states.size(), 3u);
  EXPECT_FALSE(torch::equal(before.weights.begin()->second, after.weights.begin()->second));
  for (const auto& [name, tensor] : before.optimizer)
    if (name.ends_with(".step")) {
      EXPECT_EQ(after.optimizer.at(name).item<double>(), tensor.item<double>() + 2 * kCallsPerUpdate) << name;
    }
}

}  // namespace
}  // namespace earshot
