// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/env_places.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <deque>
#include <random>
#include <utility>

#include "sim/base/errors.h"

namespace earshot {
namespace {

// Environments are handed out from the head of a queue, worker by worker, whatever the numbers of workers and environments.
TEST(EnvPlaces, EnvironmentsKeepTheirOrderInAnotherNumberOfWorkers) {
  std::mt19937 random(5);
  for (int round = 0; round < 200; ++round) {
    const auto draw = [&](int most) { return 1 + static_cast<int>(random() % static_cast<unsigned>(most)); };
    const int saved_workers = draw(9), saved_envs = draw(5), workers = draw(9), envs = draw(5);
    std::deque<std::pair<int, int>> queue;
    for (int rank = 0; rank < saved_workers; ++rank)
      for (int env = 0; env < saved_envs; ++env) queue.emplace_back(rank, env);
    int kept = 0;
    for (int place = 0; place < workers * envs; ++place) {
      const auto origin = origin_of_env(place, saved_workers, saved_envs);
      ASSERT_EQ(origin.has_value(), !queue.empty()) << round << " " << place;
      if (!origin) continue;
      EXPECT_EQ(std::pair(origin->rank, origin->env), queue.front());
      queue.pop_front();
      ++kept;
    }
    const std::string text = moved_envs_text(saved_workers, saved_envs, workers, envs);
    EXPECT_THAT(text, testing::HasSubstr(": " + std::to_string(kept) + " environments continue"));
    EXPECT_EQ(text.find("dropped") != std::string::npos, !queue.empty()) << text;
    if (!queue.empty()) {
      EXPECT_THAT(text, testing::HasSubstr("the last " + std::to_string(queue.size()) + " are dropped"));
    }
    EXPECT_EQ(text.find("new episodes") != std::string::npos, workers * envs > kept) << text;
  }
  EXPECT_FALSE(origin_of_env(0, 0, 2));
}

TEST(EnvPlaces, AnotherNumberOfWorkersHasToBeAllowed) {
  Checkpoint saved;
  saved.world_size = 3;
  saved.members = {0, 2, 3};
  saved.started_workers = 4;
  const EnvPlaces same = env_places_of(saved, 3, {});
  EXPECT_EQ(same.members, saved.members);
  EXPECT_EQ(same.started_workers, 4);
  EXPECT_FALSE(same.are_moved);
  EXPECT_THROW(env_places_of(saved, 2, {"ppo.clip"}), InputError);
  const EnvPlaces more = env_places_of(saved, 5, {"workers"});
  EXPECT_EQ(more.members, (std::vector<int>{0, 1, 2, 3, 4}));
  EXPECT_EQ(more.started_workers, 5);
  EXPECT_TRUE(more.are_moved);
  EXPECT_FALSE(env_places_of({}, 2, {}).are_moved);
}

}  // namespace
}  // namespace earshot
