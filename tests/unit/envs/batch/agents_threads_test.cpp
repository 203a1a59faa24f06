// SPDX-License-Identifier: Apache-2.0
// Agents of one env on several threads: equal bits for any number, any split and in the background.
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <thread>

#include "envs/batch/agent_team.h"
#include "tests/support/envs/agents_fixture.h"

namespace earshot {
namespace {

TEST(AgentTeam, EveryItemIsDoneOnceByAMemberOfItsOwn) {
  for (const std::size_t helpers : {1u, 3u}) {
    AgentTeam team(helpers);
    for (int round = 0; round < 300; ++round) {
      const std::size_t count = static_cast<std::size_t>(round % 7);
      std::vector<std::atomic<int>> done(count), busy(helpers + 1);
      team.run(count, [&](std::size_t item, std::size_t member) {
        EXPECT_EQ(busy[member].fetch_add(1), 0);
        ++done[item];
        busy[member].fetch_sub(1);
      });
      for (const auto& times : done) ASSERT_EQ(times.load(), 1) << round;
      if (round % 50 == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));  // helpers fall asleep
    }
  }
}

#ifdef EARSHOT_SANITIZED
// Thirty times slower, and slower again with more threads than cores; threads meet in the first step as in the last.
constexpr int kAgentSteps = 4;
constexpr std::array kAgentThreadCounts{2, 3};
#else
constexpr int kAgentSteps = 22;
constexpr std::array kAgentThreadCounts{2, 3, 4, 8};
#endif

TEST_F(SeveralAgents, ThreadsSplitsAndSendingChangeNoBit) {
  constexpr int kEnvs = 3;
  using Shown = std::vector<std::vector<std::byte>>;  // by step
  const auto roll_out = [&](int threads, const std::vector<int>& batches, bool sends) {
    std::vector<Shown> all;
    EnvConfig config = config_;
    config.threads = threads;
    int first = 0;
    for (const int envs : batches) {
      BatchedEnv env(config, set_, scenes_, envs, first, kEnvs);
      env.reset();
      std::vector<Shown> rows(static_cast<std::size_t>(env.num_rows()));
      for (int step = 0; step < kAgentSteps; ++step) {
        for (int row = 0; row < env.num_rows(); ++row) rows[static_cast<std::size_t>(row)].push_back(shown_to_agent(env, row));
        const std::vector<std::int32_t> actions = actions_of(first, envs, kAgents, step);
        if (!sends) {
          env.step(actions);
          continue;
        }
        // One after the other, last first.
        for (std::int32_t i = envs - 1; i >= 0; --i)
          env.send(std::vector<std::int32_t>{i}, std::span(actions).subspan(static_cast<std::size_t>(i) * kAgents, kAgents));
        for (int got = 0; got < envs;)
          got += static_cast<int>(env.recv(1, step % 2 == 0 ? RecvOrder::as_ready : RecvOrder::as_sent).size());
      }
      EXPECT_EQ(env.quarantine_counters().total(), 0u);
      all.insert(all.end(), rows.begin(), rows.end());
      first += envs;
    }
    return all;
  };
  const std::vector<Shown> reference = roll_out(1, {3}, false);
  for (const int threads : kAgentThreadCounts) EXPECT_TRUE(roll_out(threads, {3}, false) == reference) << threads;
#ifndef EARSHOT_SANITIZED
  EXPECT_TRUE(roll_out(1, {1, 2}, false) == reference);
  EXPECT_TRUE(roll_out(8, {2, 1}, false) == reference);
  EXPECT_TRUE(roll_out(8, {1, 1, 1}, false) == reference);
  EXPECT_TRUE(roll_out(2, {3}, true) == reference);
#endif
  EXPECT_TRUE(roll_out(kAgentThreadCounts.back(), {1, 2}, true) == reference);
}

}  // namespace
}  // namespace earshot
