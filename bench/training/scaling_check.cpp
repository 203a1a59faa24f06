// SPDX-License-Identifier: Apache-2.0
#include "bench/training/scaling_check.h"

#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <numeric>
#include <string>
#include <thread>

#include "sim/base/errors.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }
void sleep_s(double seconds) { std::this_thread::sleep_for(std::chrono::duration<double>(seconds)); }
double mean(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

double roll_out(const ScalingCheckOptions& options, std::uint32_t rank, std::uint32_t update) {
  const RandomStream random(1, Purpose::bench, rank, update);
  const auto start = Clock::now();
  const double of_rollout = std::max(0.1, 1 + options.spread * static_cast<double>(random.normal2(0)[0]));
  for (int step = 0; step < options.rollout_steps; ++step)
    sleep_s(options.step_s * of_rollout * 2 * static_cast<double>(random.uniform(static_cast<std::uint32_t>(step) + 1)));
  return seconds_since(start);
}

/// The times of all workers, in their order.
std::vector<double> of_all_workers(const std::vector<double>& rank_values, Collective& workers) {
  std::string bytes(rank_values.size() * sizeof(double), '\0');
  std::memcpy(bytes.data(), rank_values.data(), bytes.size());
  std::vector<double> all;
  for (const std::string& part : workers.all_gather(bytes)) {
    if (part.size() != bytes.size()) throw RunError("scaling check", "a worker made a different number of updates");
    all.resize(all.size() + rank_values.size());
    std::memcpy(all.data() + all.size() - rank_values.size(), part.data(), part.size());
  }
  return all;
}

/// Of all threads of this worker, in user space and in the kernel.
double processor_s() {
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& time) { return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec); };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

struct SumCost {
  double wall_s = 0, processor_s = 0;
};
/// Of a call: median of nine runs of so many, and mean of all.
SumCost cost_of_sum(std::size_t bytes, int calls, Collective& workers) {
  std::vector<float> buffer(bytes / sizeof(float));
  std::vector<double> seconds;
  const double processor_before = processor_s();
  for (int run = 0; run < 9; ++run) {
    workers.barrier();
    const auto start = Clock::now();
    for (int call = 0; call < calls; ++call) workers.all_reduce_sum(std::span<float>(buffer));
    seconds.push_back(seconds_since(start) / calls);
  }
  const double processor_of_call_s = (processor_s() - processor_before) / (9 * calls);
  std::ranges::sort(seconds);
  return {seconds[seconds.size() / 2], processor_of_call_s};
}

}  // namespace

MeasuredUpdates make_updates(const ScalingCheckOptions& options, Collective& workers) {
  const auto rank = static_cast<std::uint32_t>(workers.identity().rank);
  std::vector<float> gradient(options.bytes / sizeof(float));
  std::vector<double> rollouts, learning;
  workers.all_reduce_sum(std::span<float>(gradient));  // touches the pages
  workers.barrier();
  const auto start = Clock::now();
  for (int update = 0; update < options.updates; ++update) {
    rollouts.push_back(roll_out(options, rank, static_cast<std::uint32_t>(update)));
    double learn_s = 0;
    for (int sum = 0; sum < options.sums; ++sum) {
      const auto began = Clock::now();
      sleep_s(options.learn_s / options.sums);
      learn_s += seconds_since(began);
      workers.all_reduce_sum(std::span<float>(gradient));
    }
    learning.push_back(learn_s);
    for (int call = 0; call < options.exchanges; ++call) workers.all_gather("a status");
  }
  MeasuredUpdates measured;
  measured.update_s = seconds_since(start) / options.updates;
  measured.rollouts = of_all_workers(rollouts, workers);
  measured.learn_s = mean(of_all_workers(learning, workers));
  return measured;
}

LinkSpeed measure_link(std::size_t bytes, Collective& workers) {
  EARSHOT_EXPECT(workers.identity().world_size == 2);
  constexpr std::size_t small = 4096, least = std::size_t{1} << 18;
  const std::size_t large = std::max(bytes, 8 * least);
  const SumCost exchange = cost_of_sum(small, 200, workers), ring = cost_of_sum(least, 20, workers),
                larger = cost_of_sum(large, 3, workers);
  LinkSpeed link = link_from_sums(exchange.wall_s, {least, ring.wall_s}, {large, larger.wall_s});
  link.message_s = exchange.processor_s;
  link.byte_s = larger.processor_s / static_cast<double>(large);  // of two workers each sends as many bytes as a sum has
  return link;
}

UpdateWork work_of(const ScalingCheckOptions& options, const MeasuredUpdates& alone) {
  UpdateWork work{.rollout_s = mean(alone.rollouts),
                  .rollout_deviation_s = 0,
                  .learn_s = alone.learn_s,
                  .sums = options.sums,
                  .bytes = options.bytes,
                  .exchanges = options.exchanges};
  double squares = 0;
  for (const double rollout_s : alone.rollouts) squares += (rollout_s - work.rollout_s) * (rollout_s - work.rollout_s);
  if (alone.rollouts.size() > 1) work.rollout_deviation_s = std::sqrt(squares / static_cast<double>(alone.rollouts.size() - 1));
  return work;
}

}  // namespace earshot
