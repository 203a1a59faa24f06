// SPDX-License-Identifier: Apache-2.0
#include "envs/batch/agent_team.h"

#include <atomic>
#include <cstdint>
#include <thread>
#include <vector>

#include "sim/base/denormals.h"
#include "sim/base/processor.h"

namespace earshot {
namespace {

/// As long a thread looks for work before it sleeps: some 20 us, less than what an agent takes and more than the pause between two rounds.
constexpr int kTeamSpins = 4000;

}  // namespace

/// A round is one call of run().  Its items are claimed by a counter that holds the round too, so that a helper that comes late claims none
/// of another round.
struct AgentTeam::Shared {
  const void* body = nullptr;
  Call call = nullptr;
  std::atomic<std::uint64_t> next{0};  ///< round << 32 | items left
  std::atomic<std::uint32_t> round{0}, done{0};
  std::atomic<bool> stop{false};
  std::vector<std::thread> threads;

  void work(std::uint32_t of_round, std::size_t member) {
    std::uint64_t now = next.load(std::memory_order_acquire);
    while (static_cast<std::uint32_t>(now >> 32) == of_round && static_cast<std::uint32_t>(now) > 0) {
      if (!next.compare_exchange_weak(now, now - 1, std::memory_order_acq_rel)) continue;
      call(body, static_cast<std::uint32_t>(now) - 1, member);
      done.fetch_add(1, std::memory_order_release);
      done.notify_one();
      now = next.load(std::memory_order_acquire);
    }
  }

  void help(std::size_t member) {
    const FlushDenormals flush;
    for (std::uint32_t seen = 0;;) {
      for (int spin = 0; spin < kTeamSpins && round.load(std::memory_order_relaxed) == seen; ++spin) relax();
      round.wait(seen, std::memory_order_acquire);
      if (stop.load(std::memory_order_acquire)) return;
      seen = round.load(std::memory_order_acquire);
      work(seen, member);
    }
  }
};

AgentTeam::AgentTeam(std::size_t helpers) : shared_(std::make_unique<Shared>()) {
  for (std::size_t member = 1; member <= helpers; ++member)
    shared_->threads.emplace_back([shared = shared_.get(), member] { shared->help(member); });
}

AgentTeam::~AgentTeam() {
  shared_->stop.store(true, std::memory_order_release);
  shared_->round.fetch_add(1, std::memory_order_release);
  shared_->round.notify_all();
  for (std::thread& thread : shared_->threads) thread.join();
}

void AgentTeam::run_calls(std::size_t count, const void* body, Call call) {
  Shared& in = *shared_;
  if (count == 0) return;
  if (count == 1) return call(body, 0, 0);
  in.body = body;
  in.call = call;
  in.done.store(0, std::memory_order_relaxed);
  const std::uint32_t round = in.round.load(std::memory_order_relaxed) + 1;
  in.next.store(std::uint64_t{round} << 32 | count, std::memory_order_release);
  in.round.store(round, std::memory_order_release);
  in.round.notify_all();
  in.work(round, 0);
  for (int spin = 0; in.done.load(std::memory_order_acquire) < count; ++spin) {
    if (spin < kTeamSpins)
      relax();
    else if (const std::uint32_t done = in.done.load(std::memory_order_acquire); done < count)
      in.done.wait(done, std::memory_order_acquire);
  }
}

}  // namespace earshot
