// SPDX-License-Identifier: Apache-2.0
#include "trainer/run/update_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace earshot {
namespace {

class UpdateReportTest : public testing::Test {
 protected:
  UpdateStats stats_of(int taken_steps) {
    UpdateStats stats;
    stats.taken_steps = taken_steps;
    return stats;
  }

  RunConfig config_;
  std::unique_ptr<Collective> alone_ = make_single_worker();
  RunProgress progress_{config_};
  UpdateReport report_{config_, *alone_, progress_};
};

TEST_F(UpdateReportTest, TwentyUpdatesInARowWithoutAStepEndTheRun) {
  for (int update = 0; update < 19; ++update) EXPECT_FALSE(report_.note(stats_of(0)).has_value()) << update;
  EXPECT_FALSE(report_.note(stats_of(2)).has_value());
  for (int update = 0; update < 19; ++update) EXPECT_FALSE(report_.note(stats_of(0)).has_value()) << update;
  EXPECT_THAT(report_.note(stats_of(0)).value_or(""), testing::HasSubstr("20 updates in a row had no optimizer step"));
  EXPECT_EQ(report_.guards().taken_steps, 2u);
}

TEST_F(UpdateReportTest, GoingBackKeepsWhatHappenedToMembers) {
  const GuardCounts before = report_.guards();
  const int without_step = report_.updates_without_step();
  (void)report_.note(stats_of(0));
  (void)report_.note(stats_of(4));
  report_.note_members(MembershipChange({1, 2}, {3}));
  report_.raise_member_counts(1, 2);
  report_.go_back(before, without_step);
  EXPECT_EQ(report_.guards().taken_steps, 0u);
  EXPECT_EQ(report_.guards().lost_workers, 2u);
  EXPECT_EQ(report_.guards().joined_workers, 2u);
  EXPECT_EQ(report_.updates_without_step(), 0);
}

TEST_F(UpdateReportTest, AnotherWorkerTakesTheWholeState) {
  WorkerSums own_sums;
  own_sums.episodes.values[EpisodeSums::count] = 3;
  own_sums.episodes.values[EpisodeSums::reward] = 6;
  own_sums.counters.values[RunCounters::poses] = 7;
  class SecondOfTwo : public Collective {  // rank 1 writes nothing
   public:
    [[nodiscard]] WorkerIdentity identity() const override { return {1, 2}; }
    void all_reduce_sum(std::span<float>) override {}
    void all_reduce_sum(std::span<double>) override {}
    void broadcast(std::span<std::byte>) override {}
    void barrier() override {}
    std::vector<std::string> all_gather(const std::string& bytes) override { return {bytes, bytes}; }
  } second;
  UpdateReport source(config_, second, progress_);
  (void)source.note(stats_of(5));
  source.report(stats_of(5), own_sums, {}, 1);
  RunState state;
  source.write_to(state);
  report_.set_state(state);
  EXPECT_EQ(report_.guards().taken_steps, 5u);
  EXPECT_EQ(report_.counters()[RunCounters::poses], 7);
  RunState again;
  report_.write_to(again);
  EXPECT_EQ(again.learner.episode_window, state.learner.episode_window);
  EXPECT_FALSE(again.learner.episode_window.empty());
}

}  // namespace
}  // namespace earshot
