// SPDX-License-Identifier: Apache-2.0
#include "trainer/run/run_progress.h"

#include <gtest/gtest.h>

#include <chrono>
#include <thread>

namespace earshot {
namespace {

RunConfig run_of(std::uint64_t total_steps, double max_minutes = 0, Schedule schedule = Schedule::steps) {
  RunConfig config;
  config.total_steps = total_steps;
  config.max_minutes = max_minutes;
  config.schedule = schedule;
  return config;
}

RunPosition position_of(std::uint64_t update, std::uint64_t env_steps) {
  RunPosition position;
  position.update = update;
  position.env_steps = env_steps;
  return position;
}

TEST(RunProgress, EndsWithItsStepsAndTellsTheFraction) {
  const RunConfig config = run_of(100);
  const auto alone = make_single_worker();
  RunProgress progress(config);
  EXPECT_FALSE(progress.agree_on_end(*alone));
  EXPECT_EQ(progress.fraction(), 0);
  progress.complete_update(75);
  EXPECT_FALSE(progress.agree_on_end(*alone));
  EXPECT_EQ(progress.fraction(), 0.75);
  EXPECT_EQ(progress.remaining_s(5), 5);
  progress.complete_update(75);
  EXPECT_TRUE(progress.agree_on_end(*alone));
  EXPECT_EQ(progress.fraction(), 1);
  EXPECT_EQ(progress.remaining_s(5), 0);
}

TEST(RunProgress, AnEvaluationComesBeforeTheEndOfTheStepsAndNotBehindThatOfTheMinutes) {
  const RunConfig config = run_of(100);
  const auto alone = make_single_worker();
  RunProgress progress(config);
  progress.complete_update(100);
  EXPECT_FALSE(progress.agree_on_end(*alone, {.evaluates = true}));
  EXPECT_TRUE(progress.evaluates());
  EXPECT_FALSE(progress.agree_on_end(*alone, {.evaluates = true, .has_stopped = true}));
  EXPECT_TRUE(progress.agree_on_end(*alone));
  EXPECT_FALSE(progress.evaluates());

  RunProgress other(config);
  other.complete_update(50);
  EXPECT_FALSE(other.agree_on_end(*alone));
  EXPECT_TRUE(other.agree_on_end(*alone, {.has_stopped = true}));
  EXPECT_EQ(other.end_signal(), 0) << "done, not interrupted";

  const RunConfig minute = run_of(100, 1);
  RunProgress late(minute);
  RunPosition position = position_of(4, 50);
  position.elapsed_s = 60;
  late.set_position(position);
  EXPECT_TRUE(late.agree_on_end(*alone, {.evaluates = true}));
  EXPECT_FALSE(late.evaluates());
}

TEST(RunProgress, TimeOfAnEvaluationIsOfNoUpdate) {
  const RunConfig config = run_of(100);
  RunProgress progress(config);
  progress.start_clock();
  std::this_thread::sleep_for(std::chrono::milliseconds(40));
  progress.complete_evaluation();
  const double evaluated_s = progress.total_elapsed_s();
  EXPECT_GE(evaluated_s, 0.04);
  const double update_s = progress.complete_update(10);
  EXPECT_LT(update_s, evaluated_s) << "the clock began anew";
  EXPECT_EQ(progress.total_elapsed_s(), evaluated_s + update_s);
}

TEST(RunProgress, MinutesBoundThisSittingOrTheWholeRunByTheSchedule) {
  RunPosition resumed = position_of(4, 50);
  resumed.elapsed_before_s = 45;
  resumed.elapsed_s = 30;
  const auto alone = make_single_worker();

  const RunConfig by_steps = run_of(100, 1);
  RunProgress sitting(by_steps);
  sitting.set_position(resumed);
  EXPECT_FALSE(sitting.agree_on_end(*alone));  // 30 of 60 s
  EXPECT_EQ(sitting.fraction(), 0.5);
  EXPECT_EQ(sitting.remaining_s(0.1), 30);

  const RunConfig by_minutes = run_of(100, 1, Schedule::minutes);
  RunProgress run(by_minutes);
  run.set_position(resumed);
  EXPECT_TRUE(run.agree_on_end(*alone));  // 75 of 60 s
  EXPECT_EQ(run.fraction(), 1);
  EXPECT_EQ(run.remaining_s(0.1), 0);
}

TEST(RunProgress, GoingBackKeepsTimeAndRollout) {
  const RunConfig config = run_of(100);
  RunProgress progress(config);
  progress.set_position(position_of(3, 30));
  progress.start_clock();
  progress.note_rollout();
  std::this_thread::sleep_for(std::chrono::milliseconds(2));
  const double update_s = progress.complete_update(10);
  EXPECT_GE(update_s, 0.002);
  EXPECT_FALSE(progress.has_rollout());
  progress.go_back(3, 30);
  EXPECT_EQ(progress.update(), 3u);
  EXPECT_EQ(progress.env_steps(), 30u);
  EXPECT_TRUE(progress.has_rollout());
  EXPECT_EQ(progress.position().elapsed_s, update_s);
}

TEST(RunProgress, SpeedIsThatOfThisSitting) {
  const RunConfig config = run_of(100);
  RunProgress progress(config);
  RunPosition position = position_of(5, 60);
  position.steps_before = 40;
  position.elapsed_before_s = 1000;
  progress.set_position(position);
  EXPECT_EQ(progress.steps_per_s(), 0);
  position.elapsed_s = 10;
  progress.set_position(position);
  EXPECT_EQ(progress.steps_per_s(), 2);
  EXPECT_EQ(progress.total_elapsed_s(), 1010);
}

}  // namespace
}  // namespace earshot
