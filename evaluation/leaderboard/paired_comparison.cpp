// SPDX-License-Identifier: Apache-2.0
#include "evaluation/leaderboard/paired_comparison.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <vector>

#include "sim/base/errors.h"

namespace earshot {
namespace {

template <class Get>
PairedMetric paired(const EvaluationResult& first, const EvaluationResult& second, Get get) {
  PairedMetric metric;
  std::vector<double> differences;
  std::vector<int> scenes;
  std::map<std::string, int> numbers;
  for (std::size_t i = 0; i < first.episodes.size(); ++i) {
    const double a = get(first.episodes[i].metrics), b = get(second.episodes[i].metrics);
    differences.push_back(a - b);
    scenes.push_back(numbers.emplace(first.episodes[i].scene, static_cast<int>(numbers.size())).first->second);
    ++(a > b ? metric.wins : a < b ? metric.losses : metric.ties);
  }
  metric.difference = mean_with_interval(differences);
  if (numbers.size() >= EvaluationResult::kMinScenes) {
    const Estimate over_scenes = mean_with_group_interval(differences, scenes);
    metric.difference.low = std::min(metric.difference.low, over_scenes.low);
    metric.difference.high = std::max(metric.difference.high, over_scenes.high);
  }
  metric.p_value = sign_test_p_value(metric.wins, metric.losses);
  return metric;
}

std::string line(const char* name, const PairedMetric& metric) {
  return fmt::format("{:<8} {:+.3f} [{:+.3f}, {:+.3f}]  {:>6} {:>6} {:>6}  {:.3g}\n", name, metric.difference.mean, metric.difference.low,
                     metric.difference.high, metric.wins, metric.losses, metric.ties, metric.p_value);
}

}  // namespace

double sign_test_p_value(std::uint64_t wins, std::uint64_t losses) {
  const std::uint64_t fewer = std::min(wins, losses);
  const double n = static_cast<double>(wins) + static_cast<double>(losses);
  if (wins == losses) return 1;  // the tails meet: twice the half, and the middle counted in both
  // Sum of C(n, k) for k <= fewer, relative to its last term, which is the largest: C(n, k - 1) = C(n, k) k / (n - k + 1).
  double term = 1, sum = 1;
  for (std::uint64_t k = fewer; k > 0 && term > 1e-18 * sum; --k) {
    term *= static_cast<double>(k) / (n - static_cast<double>(k) + 1);
    sum += term;
  }
  const double last = static_cast<double>(fewer);
  const double log_choose = std::lgamma(n + 1) - std::lgamma(last + 1) - std::lgamma(n - last + 1);
  return std::min(1.0, 2 * sum * std::exp(log_choose - n * std::log(2.0)));
}

PairedComparison compare_paired(const EvaluationResult& first, const EvaluationResult& second) {
  const char* remedy = "evaluate both on the same set";
  if (first.set_hash != second.set_hash || first.episodes.size() != second.episodes.size())
    throw InputError(second.agent, "was not run on the same episodes as " + first.agent, remedy);
  for (std::size_t i = 0; i < first.episodes.size(); ++i)
    if (first.episodes[i].id != second.episodes[i].id || first.episodes[i].scene != second.episodes[i].scene)
      throw InputError(second.agent, fmt::format("has a different episode {} than {}", i, first.agent), remedy);
  return {.success = paired(first, second, [](const EpisodeMetrics& m) { return m.success; }),
          .spl = paired(first, second, [](const EpisodeMetrics& m) { return m.spl; })};
}

std::string comparison_text(const EvaluationResult& first, const EvaluationResult& second) {
  const PairedComparison comparison = compare_paired(first, second);
  const bool over_scenes = first.intervals_over_scenes();
  return fmt::format("{} less {}, {} episodes\n{:<8} {:<24}  {:>6} {:>6} {:>6}  p of the sign test\n", first.agent, second.agent,
                     first.episodes.size(), "", "difference", "better", "worse", "equal") +
         line("success", comparison.success) + line("SPL", comparison.spl) +
         fmt::format("difference [95 % interval; {}]\n", over_scenes ? "bootstrap over scenes" : "over episodes, Student's t");
}

}  // namespace earshot
