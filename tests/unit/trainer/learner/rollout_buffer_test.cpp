// SPDX-License-Identifier: Apache-2.0
#include "trainer/learner/rollout_buffer.h"

#include <gtest/gtest.h>

#include <vector>

#include "tests/support/workers/pointgoal_policy.h"

namespace earshot {
namespace {

std::vector<float> floats_of(const torch::Tensor& tensor) {
  const torch::Tensor flat = tensor.contiguous();
  return {flat.data_ptr<float>(), flat.data_ptr<float>() + flat.numel()};
}

/// An env whose reward is its time: observation t leads to reward t + 1.
class Clock {
 public:
  explicit Clock(RolloutBuffer& buffer) : buffer_(buffer) {}
  void roll_out(int steps) {
    buffer_.begin(torch::full({1, 3}, static_cast<double>(time_)));
    for (int i = 0; i < steps; ++i) {
      const auto now = static_cast<double>(time_);
      buffer_.push({{"pointgoal", torch::full({1, 2}, now)}}, torch::ones({1}), torch::zeros({1}, torch::kInt64), torch::full({1}, -now),
                   torch::full({1}, 2 * now));
      const float reward = static_cast<float>(++time_);
      const std::uint8_t no = 0, yes = 1;
      buffer_.push_outcome(std::span(&reward, 1), std::span(&no, 1), std::span(&no, 1), torch::zeros({1}), std::span(&yes, 1));
    }
    buffer_.finish(torch::full({1}, static_cast<double>(time_)));  // "value" of the observation after the last row: its time
  }

 private:
  RolloutBuffer& buffer_;
  int time_ = 0;
};

std::vector<float> rows(const RolloutBuffer& buffer, const torch::Tensor& slab) { return floats_of(slab.slice(0, 0, buffer.num_steps())); }

TEST(RolloutBuffer, AnEarlyStopLeavesNoStaleRows) {
  // docs/explanation/ppo.md, section 1.2.  The original trained the second rollout on [9, 10, 11, 4, 5, 6, 7, 8] with bootstrap 8, and the
  // third on [17, 18, 19, 12, ..., 16] with bootstrap 16.
  RolloutBuffer buffer(pointgoal_only(), 8, 1, 3);
  Clock clock(buffer);

  clock.roll_out(8);
  EXPECT_EQ(rows(buffer, buffer.rewards), (std::vector<float>{1, 2, 3, 4, 5, 6, 7, 8}));
  EXPECT_EQ(buffer.next_value.item<float>(), 8);
  EXPECT_EQ(floats_of(buffer.hidden), (std::vector<float>{0, 0, 0}));

  clock.roll_out(3);
  EXPECT_EQ(buffer.num_steps(), 3);
  EXPECT_EQ(rows(buffer, buffer.rewards), (std::vector<float>{9, 10, 11}));
  EXPECT_EQ(rows(buffer, buffer.observations["pointgoal"].select(2, 0)), (std::vector<float>{8, 9, 10}));
  EXPECT_EQ(rows(buffer, buffer.log_prob), (std::vector<float>{-8, -9, -10}));
  EXPECT_EQ(rows(buffer, buffer.values), (std::vector<float>{16, 18, 20}));
  EXPECT_EQ(buffer.next_value.item<float>(), 11);
  EXPECT_EQ(floats_of(buffer.hidden), (std::vector<float>{8, 8, 8}));

  clock.roll_out(8);
  EXPECT_EQ(rows(buffer, buffer.rewards), (std::vector<float>{12, 13, 14, 15, 16, 17, 18, 19}));
  EXPECT_EQ(rows(buffer, buffer.observations["pointgoal"].select(2, 1)), (std::vector<float>{11, 12, 13, 14, 15, 16, 17, 18}));
  EXPECT_EQ(buffer.next_value.item<float>(), 19);
  EXPECT_EQ(floats_of(buffer.hidden), (std::vector<float>{11, 11, 11}));
}

TEST(RolloutBuffer, HoldsWhatWasPushedEnvByEnv) {
  RolloutBuffer buffer(pointgoal_only(), 4, 2, 3);
  EXPECT_EQ(buffer.num_envs(), 2);
  EXPECT_FALSE(buffer.observations["depth"].defined());
  buffer.begin(torch::tensor({{1.f, 2.f, 3.f}, {4.f, 5.f, 6.f}}));
  torch::Tensor seen = torch::tensor({{1.f, 2.f}, {3.f, 4.f}});
  buffer.push({{"pointgoal", seen}}, torch::tensor({0.f, 1.f}), torch::tensor({2, 3}, torch::kInt64), torch::tensor({-1.f, -2.f}),
              torch::tensor({7.f, 8.f}));
  seen.zero_();  // a view of the env's buffer changes in the next step; the copy must not
  const std::vector<float> rewards{0.5f, -0.5f};
  const std::vector<std::uint8_t> terminated{1, 0}, truncated{0, 1}, valid{1, 0};
  buffer.push_outcome(rewards, terminated, truncated, torch::tensor({0.f, 9.f}), valid);
  buffer.finish(torch::tensor({10.f, 11.f}));

  EXPECT_EQ(rows(buffer, buffer.observations["pointgoal"]), (std::vector<float>{1, 2, 3, 4}));
  EXPECT_EQ(rows(buffer, buffer.not_done), (std::vector<float>{0, 1}));
  EXPECT_EQ(rows(buffer, buffer.actions.to(torch::kFloat32)), (std::vector<float>{2, 3}));
  EXPECT_EQ(rows(buffer, buffer.log_prob), (std::vector<float>{-1, -2}));
  EXPECT_EQ(rows(buffer, buffer.values), (std::vector<float>{7, 8}));
  EXPECT_EQ(rows(buffer, buffer.rewards), rewards);
  EXPECT_EQ(rows(buffer, buffer.terminated), (std::vector<float>{1, 0}));
  EXPECT_EQ(rows(buffer, buffer.truncated), (std::vector<float>{0, 1}));
  EXPECT_EQ(rows(buffer, buffer.final_values), (std::vector<float>{0, 9}));
  EXPECT_EQ(rows(buffer, buffer.valid), (std::vector<float>{1, 0}));
  EXPECT_EQ(floats_of(buffer.next_value), (std::vector<float>{10, 11}));
}

TEST(RolloutBuffer, HasASlabForEverySensor) {
  ObservationSpec spec;
  spec.pointgoal = true;
  spec.camera.width_px = 64;
  spec.camera.height_px = 32;
  const RolloutBuffer buffer(spec, 5, 2, 3);
  EXPECT_EQ(buffer.observations["depth"].sizes(), (std::vector<std::int64_t>{5, 2, 32, 64, 1}));
  EXPECT_EQ(buffer.observations["spectrogram"].sizes(), (std::vector<std::int64_t>{5, 2, 65, 26, 2}));
  EXPECT_EQ(buffer.observations["pointgoal"].sizes(), (std::vector<std::int64_t>{5, 2, 2}));
}

}  // namespace
}  // namespace earshot
