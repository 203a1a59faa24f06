// SPDX-License-Identifier: Apache-2.0
#include "bench/training/scaling_model.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/base/errors.h"
#include "trainer/collective/collective.h"

namespace earshot {
namespace {

double density(double x) { return std::exp(-0.5 * x * x) / std::sqrt(2 * std::numbers::pi); }
double below(double x) { return 0.5 * std::erfc(-x / std::numbers::sqrt2); }

/// Density of the k-th smallest of n draws (David and Nagaraja 2003, eq. 2.1.6), in logarithms so that n may be large.
double order_density(int k, int n, double x) {
  const double left = below(x), right = below(-x);
  if (left <= 0 || right <= 0) return 0;
  const double choices = std::lgamma(n + 1.0) - std::lgamma(static_cast<double>(k)) - std::lgamma(n - k + 1.0);
  return std::exp(choices + (k - 1) * std::log(left) + (n - k) * std::log(right)) * density(x);
}

/// Integral over the real line of f(x) times that density.
template <class Function>
double expectation(int k, int n, Function&& f) {
  constexpr double end = 9, step = 1e-3;  // smooth and 0 at both ends: the sum converges faster than any power of the step
  double sum = 0;
  for (double x = -end; x <= end; x += step) sum += f(x) * order_density(k, n, x);
  return sum * step;
}

}  // namespace

double expected_normal_order(int k, int n) {
  EARSHOT_EXPECT(k >= 1 && k <= n);
  return expectation(k, n, [](double x) { return x; });
}

LinkSpeed link_from_sums(double small_s, const TimedSum& ring, const TimedSum& larger_ring) {
  const double bytes_per_s = static_cast<double>(larger_ring.bytes - ring.bytes) / (larger_ring.seconds - ring.seconds);
  if (!(bytes_per_s > 0) || !std::isfinite(bytes_per_s)) throw RunError("link", "larger sums were not slower; measure for a longer time");
  // Two workers: two steps of half the bytes each.
  return {.exchange_s = small_s,
          .step_s = std::max(0.0, ring.seconds - static_cast<double>(ring.bytes) / bytes_per_s) / 2,
          .bytes_per_s = bytes_per_s};
}

ScalingPrediction predict_update(const UpdateWork& work, const LinkSpeed& link, const WorkerLayout& layout) {
  const int P = layout.workers;
  EARSHOT_EXPECT(P >= 1 && layout.per_host >= 1 && layout.cores_per_host >= 1);
  ScalingPrediction prediction;
  prediction.learn_s = work.learn_s;
  prediction.steps = P;
  const int enough = layout.preempt_fraction > 0 ? std::clamp(static_cast<int>(std::ceil(layout.preempt_fraction * P - 1e-9)), 1, P) : P;
  prediction.collect_s = work.rollout_s + work.rollout_deviation_s * expected_normal_order(enough, P);
  if (enough < P) {
    // A worker that would need r seconds has made the fraction collect / r of its steps when the others stop waiting.
    prediction.steps = enough;
    for (int k = enough + 1; k <= P; ++k)
      prediction.steps += std::min(1.0, prediction.collect_s / (work.rollout_s + work.rollout_deviation_s * expected_normal_order(k, P)));
  }
  if (P == 1) return prediction;
  const double per_core = static_cast<double>(std::min(P, layout.per_host)) / layout.cores_per_host;
  const double sent_bytes = 2.0 * (P - 1) / P * static_cast<double>(work.bytes);
  const double sum_s = std::max(2.0 * (P - 1) * link.step_s + sent_bytes / link.bytes_per_s, per_core * sent_bytes * link.byte_s);
  const double message_s = std::max(1.0, per_core) * link.message_s;
  if (P <= kMaxMeshWorkers) {
    prediction.reduce_s = work.sums * sum_s + work.exchanges * (link.exchange_s + (P - 2) * message_s);
  } else {
    // Rank 0 hears all and answers all; then the bytes go as P - 1 messages each way instead of by steps.
    const double call_s = 2 * (link.exchange_s + (P - 2) * message_s);
    const double bytes_s = std::max(sent_bytes / link.bytes_per_s, per_core * sent_bytes * link.byte_s);
    prediction.reduce_s = work.sums * (call_s + 2 * (P - 1) * message_s + bytes_s) + work.exchanges * call_s;
  }
  return prediction;
}

double scaling_efficiency(const UpdateWork& work, const LinkSpeed& link, const WorkerLayout& layout) {
  const ScalingPrediction predicted = predict_update(work, link, layout);
  WorkerLayout alone = layout;
  alone.workers = 1;
  return predicted.steps / layout.workers * predict_update(work, link, alone).update_s() / predicted.update_s();
}

}  // namespace earshot
