// SPDX-License-Identifier: Apache-2.0
// Where float32 is not enough: what training does in double against the same in long double, and what float32 would have given.  The errors
// that docs/evidence/precision.md quotes are printed.
#include <gtest/gtest.h>

#include "tests/support/workers/fault_bench.h"
#include "trainer/collective/collective.h"
#include "trainer/learner/advantage_normalization.h"
#include "trainer/learner/gae.h"
#include "trainer/rollout/episode_window.h"

namespace earshot::faults {
namespace {

struct LongEpisode {
  std::vector<float> rewards, values;
  float next_value = 0;
};

/// Rewards like the task's (small steps, seldom a large one), values like returns.
LongEpisode long_episode(std::size_t steps) {
  const RandomStream random(23, Purpose::test, 1, 2, 3);
  LongEpisode episode;
  for (std::size_t t = 0; t < steps; ++t) {
    const double u = random.uniform(static_cast<std::uint32_t>(2 * t)), v = random.uniform(static_cast<std::uint32_t>(2 * t + 1));
    episode.rewards.push_back(static_cast<float>(u < 0.01 ? 10.0 : 0.3 * u - 0.15));
    episode.values.push_back(static_cast<float>(500 + 100 * (v - 0.5)));
  }
  episode.next_value = 480.f;
  return episode;
}

/// The recursion of gae() for one long episode, in T.
template <class T>
std::vector<T> recursion(const LongEpisode& episode, double gamma, double lambda) {
  const std::size_t steps = episode.rewards.size();
  std::vector<T> advantages(steps);
  T later = 0, following = static_cast<T>(episode.next_value);
  for (std::size_t t = steps; t-- > 0;) {
    const T value = static_cast<T>(episode.values[t]);
    later = static_cast<T>(episode.rewards[t]) + static_cast<T>(gamma) * following - value +
            static_cast<T>(gamma) * static_cast<T>(lambda) * later;
    following = value;
    advantages[t] = later;
  }
  return advantages;
}

// 1e5 steps, gamma 0.9999: a sum over ten thousand steps.  Independent of the recursion: eq. 16 of Schulman et al. summed as it stands, in
// long double, at some steps.
TEST(X_GaePrecision, HoldsOverLongHorizons) {
  constexpr std::size_t steps = 100000;
  const LongEpisode episode = long_episode(steps);
  for (const double lambda : {0.95, 1.0}) {
    const double gamma = 0.9999;
    const auto column = [](const std::vector<float>& values) { return torch::tensor(values).unsqueeze(1); };
    const torch::Tensor rewards = column(episode.rewards), zeros = torch::zeros_like(rewards), next = torch::tensor({episode.next_value});
    const GaeConfig config{.gamma = gamma, .lambda = lambda};
    const torch::Tensor ours = gae(rewards.to(torch::kFloat64), column(episode.values), zeros, zeros, zeros, next, config);
    const std::vector<long double> exact = recursion<long double>(episode, gamma, lambda);
    const std::vector<float> single = recursion<float>(episode, gamma, lambda);
    for (const std::size_t t : {std::size_t{0}, steps / 2, steps - 1}) {
      long double direct = 0, weight = 1;
      for (std::size_t k = t; k < steps; ++k) {
        const long double following = k + 1 < steps ? episode.values[k + 1] : episode.next_value;
        direct += weight * (static_cast<long double>(episode.rewards[k]) + static_cast<long double>(gamma) * following -
                            static_cast<long double>(episode.values[k]));
        weight *= static_cast<long double>(gamma) * static_cast<long double>(lambda);
      }
      ASSERT_NEAR(static_cast<double>(exact[t]), static_cast<double>(direct), 1e-9) << t;
    }
    double scale = 0, error = 0, single_error = 0, return_error = 0, single_return_error = 0;
    const torch::Tensor returns = (ours + column(episode.values).to(torch::kFloat64)).to(torch::kFloat32);
    for (std::size_t t = 0; t < steps; ++t) {
      const double wanted = static_cast<double>(exact[t]);
      const double wanted_return = static_cast<double>(exact[t] + static_cast<long double>(episode.values[t]));
      scale = std::max(scale, std::abs(wanted));
      error = std::max(error, std::abs(ours.data_ptr<double>()[t] - wanted));
      single_error = std::max(single_error, std::abs(static_cast<double>(single[t]) - wanted));
      return_error =
          std::max(return_error, std::abs(static_cast<double>(returns.data_ptr<float>()[t]) - wanted_return) / std::abs(wanted_return));
      single_return_error = std::max(
          single_return_error, std::abs(static_cast<double>(single[t] + episode.values[t]) - wanted_return) / std::abs(wanted_return));
    }
    std::printf(
        "GAE, 1e5 steps, gamma 0.9999, lambda %.2f: largest |A| %.4g; error double %.2g, float %.2g; return, relative: %.2g, float %.2g\n",
        lambda, scale, error, single_error, return_error, single_return_error);
    EXPECT_LT(error, 1e-9);         // 1e4 effective terms around 500, each rounded to 1e-13
    EXPECT_LT(return_error, 6e-8);  // one rounding to float32
    EXPECT_GT(single_error, 1000 * error);
  }
}

// A closed form without any table: rewards of 1 for ever are worth (1 - gamma^T) / (1 - gamma).
TEST(X_GaePrecision, ReturnOfConstantRewardsIsTheGeometricSeries) {
  constexpr std::int64_t steps = 100000;
  const torch::Tensor ones = torch::ones({steps, 1}, torch::kFloat64), zeros = torch::zeros_like(ones);
  torch::Tensor terminated = zeros.clone();
  terminated[steps - 1] = 1;
  const torch::Tensor advantages = gae(ones, zeros, terminated, zeros, zeros, torch::zeros({1}), {.gamma = 0.9999, .lambda = 1.0});
  // gamma as the double that it is: log1p keeps the digits of 1 - gamma.
  const long double rest = 1.0L - static_cast<long double>(0.9999);
  const long double expected = -std::expm1(static_cast<long double>(steps) * std::log1p(-rest)) / rest;
  EXPECT_NEAR(advantages[0][0].item<double>(), static_cast<double>(expected), 1e-11 * static_cast<double>(expected));
}

TEST(X_NormPrecision, OfFiveMillionElements) {
  constexpr std::size_t count = 5'000'000;  // as many as the published policy has
  std::vector<float> gradient(count);
  const RandomStream random(29, Purpose::test, 1);
  for (std::size_t i = 0; i < count; ++i) gradient[i] = static_cast<float>(random.uniform(static_cast<std::uint32_t>(i)) - 0.5);
  for (const float scale : {1e-30f, 1e-20f, 1.f, 1e20f, 1e30f}) {
    long double exact = 0;
    double doubles = 0;
    float single = 0;
    for (const float element : gradient) {
      const float g = element * scale;
      exact += static_cast<long double>(g) * static_cast<long double>(g);
      doubles += static_cast<double>(g) * static_cast<double>(g);
      single += g * g;
    }
    const double wanted = static_cast<double>(std::sqrt(exact)), error = std::abs(std::sqrt(doubles) - wanted) / wanted;
    std::printf("norm of 5e6 elements of about %.0e: relative error double %.2g, float %.2g\n", static_cast<double>(scale), error,
                std::abs(static_cast<double>(std::sqrt(single)) - wanted) / wanted);
    EXPECT_LT(error, 1e-11);  // 5e6 additions of 1e-16 at worst in a row, 1e-13 as a walk
    if (scale < 1e-25f || scale > 1e15f) {
      EXPECT_FALSE(std::isnormal(single));  // 0 or infinity
    }
  }
}

// A spread of 58 on an offset of 1e8, which float32 just resolves: the mean square less the squared mean is off by percents, two passes
// have all.
TEST(X_NormalizationPrecision, KeepsASmallSpreadOnALargeOffset) {
  for (const double offset : {0.0, 1e4, 1e8}) {
    const torch::Tensor rows = noise({4000, 4}, 1, 2, 3).to(torch::kFloat64) * 100 + offset;
    const double* values = rows.data_ptr<double>();
    long double mean = 0, square = 0;
    double sum = 0, sum_of_squares = 0;
    for (std::int64_t i = 0; i < rows.numel(); ++i) {
      mean += static_cast<long double>(values[i]) / static_cast<long double>(rows.numel());
      sum += values[i];
      sum_of_squares += values[i] * values[i];
    }
    for (std::int64_t i = 0; i < rows.numel(); ++i)
      square += (static_cast<long double>(values[i]) - mean) * (static_cast<long double>(values[i]) - mean);
    const auto count = static_cast<double>(rows.numel());
    const double deviation = static_cast<double>(std::sqrt(square / static_cast<long double>(rows.numel())));
    const double one_pass = std::sqrt(std::max(0.0, sum_of_squares / count - sum / count * (sum / count)));
    const torch::Tensor ours = normalize_advantages(rows, torch::ones_like(rows).to(torch::kBool), *make_single_worker());
    double error = 0;
    for (std::int64_t i = 0; i < rows.numel(); ++i)
      error = std::max(error, std::abs(ours.data_ptr<double>()[i] - static_cast<double>((static_cast<long double>(values[i]) - mean) /
                                                                                        static_cast<long double>(deviation + 1e-7))));
    std::printf("normalization, offset %.0e, spread %.2f: largest error %.2g; spread in one pass %.4g\n", offset, deviation, error,
                one_pass);
    EXPECT_LT(error, 1e-7);
    if (offset == 1e8) {
      EXPECT_GT(std::abs(one_pass - deviation), 1e-3 * deviation);
    }
  }
}

// Sums of metrics over a week: ten million episodes of success 0.1 (not exact in binary), a million curve points of seconds.
TEST(X_MetricSums, StayExactOverAWeek) {
  EpisodeSums sums;
  float single = 0;
  EpisodeMetrics metrics;
  metrics.spl = 0.1;
  metrics.steps = 500;
  constexpr int episodes = 10'000'000;
  for (int i = 0; i < episodes; ++i) {
    sums.add(metrics);
    single += 0.1f;
  }
  std::printf("mean of 1e7 values of 0.1: error double %.2g, float %.2g\n", std::abs(sums.mean(EpisodeSums::spl) - 0.1),
              std::abs(static_cast<double>(single) / episodes - 0.1));
  EXPECT_NEAR(sums.mean(EpisodeSums::spl), 0.1, 1e-9);
  EXPECT_EQ(sums.values[EpisodeSums::steps], 5e9);
  EXPECT_GT(std::abs(static_cast<double>(single) / episodes - 0.1), 1e-3);

  // The window is summed anew: what has left it leaves no rounding behind.
  EpisodeWindow window;
  EpisodeSums huge = {}, small = {};
  huge.values.fill(1e17);
  huge.values[EpisodeSums::count] = 200;
  small.values.fill(0.1);
  small.values[EpisodeSums::count] = 200;
  window.push(huge);
  window.push(small);
  EXPECT_EQ(window.total().values[EpisodeSums::spl], 0.1);
}

// The loss is a mean over at most some thousand rows in float32: torch sums in blocks, so the error stays near one rounding.
TEST(X_LossPrecision, MeanOverAMinibatch) {
  constexpr std::int64_t rows = 150 * 64;
  const torch::Tensor log_prob = -1 + noise({rows}, 1, 1, 1), old = log_prob + 0.01 * noise({rows}, 1, 1, 2),
                      advantages = noise({rows}, 1, 1, 3) * 30, values = 400 + noise({rows}, 1, 1, 4),
                      returns = 400 + 30 * noise({rows}, 1, 1, 5), entropies = 1 + 0.1 * noise({rows}, 1, 1, 6),
                      valid = torch::ones({rows});
  const auto total = [&](torch::ScalarType type) {
    const auto in = [type](const torch::Tensor& tensor) { return tensor.to(type); };
    return ppo_loss(in(log_prob), in(old), in(advantages), in(values), in(values), in(returns), in(entropies), valid, 0.2, {})
        .total.item<double>();
  };
  const double exact = total(torch::kFloat64), error = std::abs(total(torch::kFloat32) - exact) / std::abs(exact);
  std::printf("loss over 9,600 rows: relative error of float %.2g\n", error);
  EXPECT_LT(error, 1e-6);
}

}  // namespace
}  // namespace earshot::faults
