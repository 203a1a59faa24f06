// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <exception>
#include <functional>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/wait_until.h"
#include "tests/support/workers/worker_processes.h"

namespace earshot {

inline constexpr std::size_t kRoundElements = 200001;  // round the ring, in more than one chunk

/// A run that goes on without a lost worker, and what one that joins must have in common with it.
inline RingConfig joinable(RingConfig config) {
  config.network.on_loss = OnLoss::go_on;
  config.heartbeat = std::chrono::milliseconds(400);  // longer than a loaded machine keeps a process from its core
  config.engine = "engine-1";
  config.settings = "ppo.clip=0.2\nseed=3\n";
  return config;
}

/// What the processes of a test tell each other.
struct SharedRounds {
  std::atomic<int> rounds[8];   ///< made by each rank
  std::atomic<int> in_view[8];  ///< workers in the view of each rank
  std::atomic<int> joined;      ///< workers that have entered
  std::atomic<int> stop, hold;
};

/// Makes rounds like updates: a vote with which joiners are admitted, a large sum, a small one.
class Rounds {
 public:
  Rounds(Collective& collective, int rank, SharedRounds& shared) : collective_(collective), rank_(rank), shared_(shared) {}

  /// Until told to stop; false where a sum was wrong.
  bool run(const std::function<void(bool joiners)>& before_admission = {}) {
    while (true) try {
        shared_.in_view[rank_] = collective_.identity().world_size;
        std::array<double, 2> votes{shared_.stop > 0 ? 1.0 : 0.0, collective_.has_joiners() ? 1.0 : 0.0};
        collective_.all_reduce_sum(std::span<double>(votes));
        if (votes[0] > 0) return right;
        if (before_admission) before_admission(votes[1] > 0);
        if (votes[1] > 0) collective_.admit();
        double expected = 0;
        for (const int member : collective_.members()) expected += 1 << member;
        for (const std::size_t count : {kRoundElements, std::size_t{5}}) {
          buffer_.assign(count, static_cast<float>(1 << rank_));
          collective_.all_reduce_sum(std::span<float>(buffer_));
          for (const float value : buffer_) right = right && static_cast<double>(value) == expected;
        }
        ++shared_.rounds[rank_];
      } catch (const MembershipChange& change) {
        lost.insert(lost.end(), change.lost().begin(), change.lost().end());
        joined.insert(joined.end(), change.joined().begin(), change.joined().end());
      }
  }

  bool right = true;
  std::vector<int> lost, joined;

 private:
  Collective& collective_;
  int rank_;
  SharedRounds& shared_;
  std::vector<float> buffer_;
};

/// A run whose workers make rounds, in processes of their own, some of which are lost and come back.
class JoiningWorkers : public testing::Test {
 protected:
  static constexpr unsigned kAlarm_s = 240;  ///< several losses and joins in turn, on a loaded machine
  SharedRounds& shared() { return shared_[0]; }
  void wait_for(const std::function<bool()>& condition) { EXPECT_TRUE(wait_until(condition, 60)); }
  /// All of these have a view of so many workers, and make three more rounds with it.
  void wait_for_rounds(const std::vector<int>& ranks, int world_size) {
    for (const int rank : ranks) wait_for([&] { return shared().in_view[rank] == world_size; });
    std::vector<int> at;
    for (const int rank : ranks) at.push_back(shared().rounds[rank]);
    for (std::size_t i = 0; i < ranks.size(); ++i)
      wait_for([&] { return shared().rounds[ranks[i]] >= at[i] + 3 && shared().in_view[ranks[i]] == world_size; });
  }
  virtual RingConfig ring(int rank, int world_size) { return joinable(ring_in(folder_, rank, world_size)); }
  /// Workers of the first world that make rounds until the end.
  WorkerProcesses::Body member(int world_size, const std::function<void(int rank, bool joiners)>& before_admission = {}) {
    return [this, world_size, before_admission](int rank) {
      ::alarm(kAlarm_s);
      const auto collective = make_zmq_ring(ring(rank, world_size));
      collective->brief("known");
      Rounds rounds(*collective, rank, shared());
      return rounds.run([&](bool joiners) {
        if (before_admission) before_admission(rank, joiners);
      });
    };
  }
  /// A worker that joins and makes rounds like the others.
  WorkerProcesses::Body joiner(int rank, int world_size) {
    return [this, rank, world_size](int) {
      ::alarm(kAlarm_s);
      const auto collective = make_joining_worker(ring(rank, world_size));
      if (!collective->is_joining() || collective->briefing() != "known") return false;
      collective->enter();
      collective->confirm_join();
      collective->brief("known");
      ++shared().joined;
      if (collective->is_joining() || !collective->survives_loss()) return false;
      return Rounds(*collective, rank, shared()).run();
    };
  }
  static void expect_refused(const RingConfig& config, const std::string& why) {
    WorkerProcesses process(1, [&](int) {
      try {
        make_joining_worker(config)->enter();
      } catch (const std::exception& error) {
        std::fprintf(stderr, "refused: %s\n", error.what());
        return std::string(error.what()).find(why) != std::string::npos && std::string(error.what()).find('\n') == std::string::npos;
      }
      return false;
    });
    EXPECT_EQ(process.wait(0), 0) << why;
  }
  void end(WorkerProcesses& workers, const std::vector<int>& ranks) {
    shared().stop = 1;
    for (const int rank : ranks) EXPECT_EQ(workers.wait(rank), 0) << "worker " << rank;
  }

  PrivateTestFolder folder_;
  SharedArray<SharedRounds, 1> shared_;
};

}  // namespace earshot
