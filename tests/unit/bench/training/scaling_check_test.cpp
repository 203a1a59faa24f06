// SPDX-License-Identifier: Apache-2.0
#include "bench/training/scaling_check.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <ctime>
#include <map>
#include <numeric>
#include <thread>

namespace earshot {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kSmall = 4096, kRing = 262144, kLarge = 3145728;

/// Of all threads of this process.
double processor_s() {
  timespec now{};
  ::clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

double mean(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

/// What a call has taken, on the clock and of the processor.
struct Taken {
  double all_s = 0, processor_s = 0;
};
double sum_of(const std::vector<Taken>& calls, double Taken::*part) {
  return std::accumulate(calls.begin(), calls.end(), 0.0, [&](double sum, const Taken& call) { return sum + call.*part; });
}

/// Two workers whose calls take known times at least, a part of them of the processor, and note what they have taken: a machine that is
/// busy makes them longer.
class TimedCalls : public Collective {
 public:
  static constexpr double kExchange_s = 5e-4, kStep_s = 1e-3, kBytesPerS = 2e8;
  static constexpr double kMessage_s = 1e-4, kByte_s = 1e-9;

  [[nodiscard]] WorkerIdentity identity() const override { return {0, 2}; }
  void all_reduce_sum(std::span<float> buffer) override {
    const std::size_t bytes = buffer.size_bytes();
    const auto size = static_cast<double>(bytes);
    if (bytes < 65536)
      take(kExchange_s, kMessage_s, seconds_[bytes]);
    else
      take(2 * kStep_s + size / kBytesPerS, size * kByte_s, seconds_[bytes]);
  }
  void all_reduce_sum(std::span<double>) override { throw RunError("timed calls", "sum single precision alone"); }
  void broadcast(std::span<std::byte>) override {}
  void barrier() override {
    for (auto& [bytes, runs] : seconds_)
      if (!runs.back().empty()) runs.emplace_back();
  }
  std::vector<std::string> all_gather(const std::string& bytes) override {
    take(kExchange_s, 0, gathers_);
    return {bytes, bytes};
  }

  /// Median over the runs between barriers of a call's mean.
  [[nodiscard]] double median_of_sum_s(std::size_t bytes) const {
    std::vector<double> means;
    for (const std::vector<Taken>& run : seconds_.at(bytes))
      if (!run.empty()) means.push_back(sum_of(run, &Taken::all_s) / static_cast<double>(run.size()));
    std::ranges::sort(means);
    return means[means.size() / 2];
  }
  /// Mean over all calls of this size.
  [[nodiscard]] double processor_of_sum_s(std::size_t bytes) const {
    double sum = 0;
    std::size_t calls = 0;
    for (const std::vector<Taken>& run : seconds_.at(bytes)) {
      sum += sum_of(run, &Taken::processor_s);
      calls += run.size();
    }
    return sum / static_cast<double>(calls);
  }
  /// Of all calls since the last barrier.
  [[nodiscard]] double all_s() const {
    double sum = 0;
    for (const auto& [bytes, runs] : seconds_) sum += sum_of(runs.back(), &Taken::all_s);
    return sum + sum_of(gathers_.back(), &Taken::all_s);
  }

 private:
  using Runs = std::vector<std::vector<Taken>>;
  struct OfSize : Runs {
    OfSize() : Runs(1) {}
  };

  static void take(double seconds, double of_processor_s, Runs& runs) {
    const auto start = Clock::now();
    const double begin = processor_s();
    while (processor_s() - begin < of_processor_s) continue;
    std::this_thread::sleep_until(start + std::chrono::duration<double>(seconds));
    runs.back().push_back({std::chrono::duration<double>(Clock::now() - start).count(), processor_s() - begin});
  }

  std::map<std::size_t, OfSize> seconds_;
  OfSize gathers_;
};

// Rollouts of 1, 2, 4 and 5 s: mean 3, squares of what they differ by 4 + 1 + 1 + 4, over one less than their number.
TEST(ScalingCheck, WorkByHand) {
  ScalingCheckOptions options;
  options.sums = 3, options.bytes = 700, options.exchanges = 5, options.learn_s = 9;
  const UpdateWork work = work_of(options, {.update_s = 8, .rollouts = {1, 2, 4, 5}, .learn_s = 0.25});
  EXPECT_EQ(work.rollout_s, 3);
  EXPECT_NEAR(work.rollout_deviation_s, 1.8257419, 1e-7);
  EXPECT_EQ(work.learn_s, 0.25);  // as measured
  EXPECT_EQ(work.sums, 3);
  EXPECT_EQ(work.bytes, 700u);
  EXPECT_EQ(work.exchanges, 5);
  EXPECT_EQ(work_of(options, {.update_s = 8, .rollouts = {2}, .learn_s = 0.25}).rollout_deviation_s, 0);
}

TEST(ScalingCheck, LinkIsWhatItsCallsTake) {
  TimedCalls workers;
  const LinkSpeed link = measure_link(kLarge, workers);
  const double exchange_s = workers.median_of_sum_s(kSmall), ring_s = workers.median_of_sum_s(kRing),
               large_s = workers.median_of_sum_s(kLarge);
  EXPECT_GE(link.exchange_s, TimedCalls::kExchange_s);
  EXPECT_NEAR(link.exchange_s, exchange_s, 0.1 * exchange_s);
  const double bytes_per_s = (3145728 - 262144) / (large_s - ring_s);
  EXPECT_NEAR(link.bytes_per_s, bytes_per_s, 0.1 * bytes_per_s);
  const double step_s = (ring_s - 262144 / bytes_per_s) / 2;
  EXPECT_NEAR(link.step_s, step_s, 0.2 * step_s);
  const double message_s = workers.processor_of_sum_s(kSmall);
  EXPECT_GE(link.message_s, TimedCalls::kMessage_s);
  EXPECT_NEAR(link.message_s, message_s, 0.2 * message_s);
  const double byte_s = workers.processor_of_sum_s(kLarge) / static_cast<double>(kLarge);
  EXPECT_GE(link.byte_s, TimedCalls::kByte_s);
  EXPECT_NEAR(link.byte_s, byte_s, 0.2 * byte_s);
}

TEST(ScalingCheck, PartsOfAnUpdateAddUp) {
  ScalingCheckOptions options;
  options.updates = 8, options.rollout_steps = 16, options.step_s = 2e-3, options.spread = 0;
  options.learn_s = 0.02, options.sums = 4, options.bytes = 1'000'000, options.exchanges = 3;
  TimedCalls workers;
  const auto start = Clock::now();
  const MeasuredUpdates measured = make_updates(options, workers);
  const double all_s = std::chrono::duration<double>(Clock::now() - start).count();
  EXPECT_EQ(measured.rollouts.size(), 16u);  // of two workers
  EXPECT_GE(measured.learn_s, 0.02);
  EXPECT_GE(mean(measured.rollouts), 0.8 * 16 * 2e-3);  // 128 draws from between 0 and 4 ms, of which 5 % are the deviation of the mean
  EXPECT_LE(measured.update_s, all_s / 8);
  // Sums of 7 ms each and three exchanges: no less than 29.5 ms.
  const double calls_s = workers.all_s() / 8;
  EXPECT_GE(measured.update_s, measured.learn_s + mean(measured.rollouts) + 29.5e-3);
  EXPECT_NEAR(measured.update_s, measured.learn_s + mean(measured.rollouts) + calls_s, 0.1 * measured.update_s);
}

}  // namespace
}  // namespace earshot
