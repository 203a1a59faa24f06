// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/checkpoint_keeper.h"

#include <gtest/gtest.h>

#include <limits>
#include <set>

#include "tests/support/workers/worker_processes.h"
#include "trainer/checkpoint/checkpoint.h"

namespace earshot {
namespace {

constexpr double kNoEpisode = std::numeric_limits<double>::quiet_NaN();

class Keeping : public testing::Test {
 protected:
  /// As the training loop does: save, then tell the keeper.
  void save(CheckpointKeeper& keeper, std::uint64_t update, double reward, bool last = false) {
    Checkpoint checkpoint;
    checkpoint.update = update;
    checkpoint.mean_reward = reward;
    checkpoint.weights["w"] = torch::full({10}, static_cast<double>(update));
    const auto file = last ? run_.last_checkpoint() : run_.checkpoint_of(update);
    save_checkpoint(checkpoint, file);
    keeper.saved(file, checkpoint, last);
  }
  [[nodiscard]] std::set<std::string> names() const {
    std::set<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(folder_.path() / "checkpoints")) names.insert(entry.path().filename());
    return names;
  }
  [[nodiscard]] std::uint64_t best() const { return load_checkpoint(run_.best_checkpoint()).update; }

  PrivateTestFolder folder_;
  RunFolder run_{folder_.path()};
};

TEST_F(Keeping, NewestAndBestStay) {
  CheckpointKeeper keeper(run_, 3, 0);
  save(keeper, 10, kNoEpisode);
  EXPECT_EQ(names(), (std::set<std::string>{"update_000010.ckpt"}));
  save(keeper, 20, 1.5);
  save(keeper, 30, 1.5);  // no better
  save(keeper, 40, -2);
  EXPECT_EQ(names(), (std::set<std::string>{"best.ckpt", "update_000020.ckpt", "update_000030.ckpt", "update_000040.ckpt"}));
  save(keeper, 50, 0);
  save(keeper, 60, kNoEpisode);
  EXPECT_EQ(names(), (std::set<std::string>{"best.ckpt", "update_000040.ckpt", "update_000050.ckpt", "update_000060.ckpt"}));
  EXPECT_EQ(best(), 20u);
  save(keeper, 60, 3, true);
  EXPECT_EQ(best(), 60u);
  EXPECT_TRUE(names().contains("last.ckpt"));
  EXPECT_EQ(find_checkpoint(folder_.path()).filename(), "update_000060.ckpt") << "of equals the name of the update";
}

TEST_F(Keeping, AResumedRunKnowsTheBestSoFar) {
  {
    CheckpointKeeper keeper(run_, 2, 0);
    save(keeper, 10, 5);
    save(keeper, 15, 1, true);
  }
  CheckpointKeeper keeper(run_, 2, 15);
  save(keeper, 20, 4);
  EXPECT_EQ(best(), 10u);
  EXPECT_EQ(names(), (std::set<std::string>{"best.ckpt", "update_000010.ckpt", "update_000020.ckpt"})) << "last.ckpt is of an earlier end";
}

// Resumed from update 10 where the run had gone on to 40: what is made anew must not be found first.
TEST_F(Keeping, LaterUpdatesGoOnceTheirSuccessorIsSaved) {
  {
    CheckpointKeeper keeper(run_, 9, 0);
    for (const std::uint64_t update : {10, 20, 30}) save(keeper, update, static_cast<double>(update));
    save(keeper, 40, 40, true);
  }
  CheckpointKeeper keeper(run_, 9, 10);
  EXPECT_EQ(names().size(), 5u);
  save(keeper, 15, kNoEpisode);
  EXPECT_EQ(names(), (std::set<std::string>{"update_000010.ckpt", "update_000015.ckpt"}));
  EXPECT_EQ(load_checkpoint(find_checkpoint(folder_.path())).update, 15u);
}

// Of a run that evaluates itself: whatever the reward.
TEST_F(Keeping, TheBestOfTheEvaluationsIsTheBest) {
  const auto save_evaluated = [&](CheckpointKeeper& keeper, std::uint64_t update, double reward, std::uint64_t best_update) {
    Checkpoint checkpoint;
    checkpoint.update = update;
    checkpoint.mean_reward = reward;
    checkpoint.held_out = HeldOutState{.evaluations = 1, .last_update = update, .best_update = best_update};
    checkpoint.weights["w"] = torch::ones({1});
    save_checkpoint(checkpoint, run_.checkpoint_of(update));
    keeper.saved(run_.checkpoint_of(update), checkpoint, false);
  };
  CheckpointKeeper keeper(run_, 2, 0);
  save_evaluated(keeper, 0, kNoEpisode, 0);
  EXPECT_FALSE(names().contains("best.ckpt")) << "of a run that was ended before its first update";
  save_evaluated(keeper, 10, 9, 0);
  EXPECT_FALSE(names().contains("best.ckpt")) << "nothing has been evaluated yet";
  save_evaluated(keeper, 20, kNoEpisode, 20);
  EXPECT_EQ(best(), 20u);
  save_evaluated(keeper, 30, 99, 20);
  save_evaluated(keeper, 40, 100, 20);
  EXPECT_EQ(best(), 20u);
  save_evaluated(keeper, 50, 1, 50);
  EXPECT_EQ(best(), 50u);

  // Resumed from 40, when 50 is of a future that has not been: the best is that of then again, where it is still there.
  CheckpointKeeper resumed(run_, 2, 40);
  save_evaluated(resumed, 45, 0, 40);
  EXPECT_EQ(best(), 40u);
}

TEST_F(Keeping, ADamagedBestIsReplaced) {
  CheckpointKeeper first(run_, 3, 0);
  save(first, 10, 7);
  std::filesystem::resize_file(run_.best_checkpoint(), 40);
  CheckpointKeeper second(run_, 3, 10);
  save(second, 20, 2);
  EXPECT_EQ(best(), 20u);
}

}  // namespace
}  // namespace earshot
