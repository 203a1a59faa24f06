// SPDX-License-Identifier: Apache-2.0
// A schedule of faults, as the simulation draws and prints them, played against real worker processes.
#include "tests/support/simulation/fault_schedule.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <thread>

#include "sim/base/errors.h"
#include "tests/support/files/test_paths.h"
#include "tests/support/seconds_since.h"
#include "tests/support/workers/worker_processes.h"

namespace earshot::simulation {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kWorld = 4;
constexpr double kGoesOnWithin_s = 2;

/// Sums of the workers, from the start of the test.
struct Progress {
  std::atomic<int> sums = 0;
  std::atomic<double> last_s = 0, longest_gap_s = 0;
  std::atomic<bool> right = true;
};

/// Plays kill and stop by signals.
class FaultPlayer {
 public:
  FaultPlayer(WorkerProcesses& workers, std::vector<Fault> faults) : workers_(workers), faults_(std::move(faults)) {
    std::ranges::sort(faults_, {}, &Fault::at_s);
  }
  void play() {
    const auto start = Clock::now();
    const auto sleep_to = [&](double seconds) {
      std::this_thread::sleep_until(start + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds)));
    };
    for (const Fault& fault : faults_) {
      ASSERT_TRUE(fault.kind == Fault::Kind::kill || fault.kind == Fault::Kind::stop) << "signals only";
      sleep_to(fault.at_s);
      ::kill(workers_.pid(fault.rank), fault.kind == Fault::Kind::kill ? SIGKILL : SIGSTOP);
      if (fault.kind != Fault::Kind::stop) continue;
      sleep_to(fault.at_s + fault.duration_s);
      ::kill(workers_.pid(fault.rank), SIGCONT);
    }
  }

 private:
  WorkerProcesses& workers_;
  std::vector<Fault> faults_;
};

TEST(FaultSchedule, RefusesAmountsOutsideTheirRange) {
  const auto amount_of = [](const std::string& line) { return decode_schedule(line, "text").at(0).amount; };
  for (const double fraction : {0.0, 0.01, 0.5, 1.0})
    EXPECT_EQ(amount_of(fmt::format("lose rank=1 amount={} duration_s=1", fraction)), fraction);
  EXPECT_EQ(amount_of("delay rank=1 amount=2.5 duration_s=1"), 2.5);
  for (const char* const line : {"lose rank=1 amount=1.01", "lose rank=1 amount=5", "lose rank=1 amount=-0.1", "lose rank=1 amount=nan",
                                 "delay rank=1 amount=-0.02", "delay rank=1 amount=nan"})
    try {
      (void)decode_schedule(std::string("kill rank=0 at_s=1\n") + line, "text");
      ADD_FAILURE() << line;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find("text:2"), std::string::npos) << error.what();
    }
}

class FaultScheduleFiles : public testing::TestWithParam<const char*> {};

// Rank 0 among those killed.  Half a second more for a loaded machine.
TEST_P(FaultScheduleFiles, TheOthersGoOnWithinTwoSeconds) {
  const auto faults = read_schedule(source_dir() / "tests/unit/trainer/collective/schedules" / GetParam());
  double last_s = 0;
  std::vector<int> left;
  for (const Fault& fault : faults) last_s = std::max(last_s, fault.at_s + fault.duration_s);
  for (int rank = 0; rank < kWorld; ++rank)
    if (std::ranges::none_of(faults, [&](const Fault& fault) { return fault.kind == Fault::Kind::kill && fault.rank == rank; }))
      left.push_back(rank);
  ASSERT_GE(left.size(), 1u);

  PrivateTestFolder folder;
  SharedArray<Progress, 1> progress;
  progress[0].right = true;
  const auto start = Clock::now();
  WorkerProcesses workers(kWorld, [&](int rank) {
    RingConfig config = ring_in(folder, rank, kWorld);
    config.network.on_loss = OnLoss::go_on;
    const auto collective = make_zmq_ring(config);
    const bool measures = rank == left.front();
    std::vector<float> buffer;
    bool ends = false;
    while (!ends) try {
        const auto members = collective->members();
        double expected = 0;
        for (const int member : members) expected += 1 << member;
        buffer.assign(30001, static_cast<float>(1 << rank));
        collective->all_reduce_sum(buffer);
        double votes = seconds_since(start) > last_s + 3 ? 1 : 0;
        collective->all_reduce_sum(std::span<double>(&votes, 1));
        ends = votes > 0;
        if (std::ranges::any_of(buffer, [&](float value) { return static_cast<double>(value) != expected; })) progress[0].right = false;
        if (!measures) continue;
        const double now_s = seconds_since(start);
        if (progress[0].sums++ > 0) progress[0].longest_gap_s = std::max<double>(progress[0].longest_gap_s, now_s - progress[0].last_s);
        progress[0].last_s = now_s;
      } catch (const MembershipChange&) {
      }
    return collective->members() == left;
  });
  ASSERT_TRUE(workers.wait_until([&] { return progress[0].sums > 5; }));
  FaultPlayer(workers, faults).play();
  for (const int rank : left) EXPECT_EQ(workers.wait(rank), 0) << "worker " << rank;
  EXPECT_TRUE(progress[0].right);
  std::printf("%d sums, the longest pause %.0f ms\n", progress[0].sums.load(), 1000 * progress[0].longest_gap_s.load());
  EXPECT_LT(progress[0].longest_gap_s, kGoesOnWithin_s + 0.5);
}

INSTANTIATE_TEST_SUITE_P(Killed, FaultScheduleFiles, testing::Values("coordinator.txt", "two_in_turn.txt", "stopped_and_killed.txt"));

}  // namespace
}  // namespace earshot::simulation
