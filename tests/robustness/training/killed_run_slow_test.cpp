// SPDX-License-Identifier: Apache-2.0
// A run that is killed as a whole, again and again at random instants, and resumed each time: it ends at the bits of the unbroken one.
#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include <chrono>
#include <csignal>
#include <thread>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/random.h"
#include "tests/support/workers/worker_processes.h"
#include "trainer/checkpoint/checkpoint.h"
#include "trainer/checkpoint/run_folder.h"
#include "trainer/curves/event_log.h"
#include "trainer/run/episode_data.h"
#include "trainer/run/train_loop.h"

namespace earshot {
namespace {

constexpr int kWorld = 2, kUpdates = 100, kKills = 50;
constexpr unsigned kLongest_s = 600;  // of a run, before its workers are killed

std::string tiny_yaml(const std::filesystem::path& folder) {
  return "name: tiny\nseed: 5\nenvs_per_worker: 2\nrollout_steps: 6\ncheckpoint_every: 1\nkeep: 3\ntotal_steps: " +
         std::to_string(kUpdates * kWorld * 2 * 6) +
         "\nenv:\n  task: {max_steps: 12}\n  observation: {depth: false, camera: {width_px: 40, height_px: 40}}\n  acoustics: {rays: 4, "
         "rir_length_s: 0.1, early_order: 0}\n"
         "policy: {hidden_size: 8, visual_features: 8, audio_features: 8, conv_channels: 2}\n"
         "ppo: {learning_rate: 1.0e-3, linear_learning_rate_decay: true}\n"
         "data:\n  train: {file: " +
         (folder / "train.json.gz").string() +
         ", scenes: [\"shoebox:5x3x4@0.2\"], episodes_per_scene: 12, sounds: [\"synth:telephone\"], filter: {min_geodesic_m: 1, min_ratio: "
         "1}}\n";
}

class KilledRun : public testing::Test {
 protected:
  void SetUp() override {
    WorkerProcesses generator(1, [&](int) {
      const RunConfig config = parse_run_config(tiny_yaml(folder_.path()), "tiny", {});
      return !generate_data(config.train, config.env).episodes.empty();
    });
    generator.expect_all_succeed();
  }
  [[nodiscard]] std::filesystem::path out(const std::string& name) const { return folder_.path() / name; }
  [[nodiscard]] std::unique_ptr<WorkerProcesses> start(const std::string& name) {
    RunStart from;
    if (!RunFolder(out(name)).checkpoints().empty()) from.resume = find_checkpoint(out(name));
    const std::string meet = (folder_.path() / ("meet" + std::to_string(++starts_))).string();  // sockets of the killed stay behind
    return std::make_unique<WorkerProcesses>(kWorld, [this, name, from, meet](int rank) {
      ::alarm(kLongest_s);
      spdlog::set_level(spdlog::level::err);
      if (std::freopen("/dev/null", "w", stderr) == nullptr) return false;  // a line per update
      const RunConfig config = parse_run_config(tiny_yaml(folder_.path()), "tiny", {"out=" + out(name).string()});
      RingConfig ring = ring_in(folder_, rank, kWorld);
      ring.rendezvous = "ipc://" + meet;
      const auto collective = make_zmq_ring(ring);
      return train(config, *collective, from).updates == kUpdates;
    });
  }
  static void expect_same(const Checkpoint& a, const Checkpoint& b) {
    for (const auto& [name, tensor] : a.weights) EXPECT_TRUE(torch::equal(tensor, b.weights.at(name))) << name;
    ASSERT_EQ(a.optimizer.size(), b.optimizer.size());
    for (const auto& [name, tensor] : a.optimizer) EXPECT_TRUE(torch::equal(tensor, b.optimizer.at(name))) << name;
    EXPECT_EQ(a.env_states, b.env_states);
    EXPECT_EQ(a.episode_window, b.episode_window);
    for (std::size_t rank = 0; rank < kWorld; ++rank) EXPECT_TRUE(torch::equal(a.hidden.at(rank), b.hidden.at(rank))) << rank;
  }

  PrivateTestFolder folder_;
  int starts_ = 0;
};

TEST_F(KilledRun, FiftyKillsLeaveNoTrace) {
  const auto began = std::chrono::steady_clock::now();
  start("unbroken")->expect_all_succeed();
  const double run_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
  const Checkpoint unbroken = load_checkpoint(out("unbroken") / "checkpoints/last.ckpt");
  int kills = 0, finished = 0;
  for (std::uint32_t attempt = 0; kills < kKills || finished == 0; ++attempt) {
    auto workers = start("killed");
    // From the first moments, where nothing is loaded yet, to a few updates; none once there have been enough.
    const double wait_s = RandomStream(31, Purpose::test, attempt).uniform(0) * 0.5 * run_s;
    if (kills < kKills) {
      std::this_thread::sleep_for(std::chrono::duration<double>(wait_s));
      for (int rank = 0; rank < kWorld; ++rank) ::kill(workers->pid(rank), SIGKILL);
      bool ended = true;  // before it was killed
      for (int rank = 0; rank < kWorld; ++rank) ended = (workers->wait(rank) == 0) && ended;
      ++kills;
      if (!ended) continue;
    } else {
      workers->expect_all_succeed();
    }
    ++finished;
    expect_same(load_checkpoint(out("killed") / "checkpoints/last.ckpt"), unbroken);
    const auto points = read_event_log(out("killed") / "events.jsonl");
    ASSERT_EQ(points.size(), static_cast<std::size_t>(kUpdates));
    for (std::size_t i = 0; i < points.size(); ++i) EXPECT_EQ(points[i].update, i + 1);
    for (const auto& file : std::filesystem::directory_iterator(out("killed") / "checkpoints"))
      EXPECT_EQ(file.path().extension(), ".ckpt") << file.path();
    std::filesystem::remove_all(out("killed"));
  }
  std::printf("%d kills, %d runs to their end, each with the bits of the unbroken one (%.1f s)\n", kills, finished, run_s);
}

}  // namespace
}  // namespace earshot
