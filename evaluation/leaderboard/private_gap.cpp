// SPDX-License-Identifier: Apache-2.0
#include "evaluation/leaderboard/private_gap.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "sim/base/errors.h"

namespace earshot {
namespace {

std::string shown(const Estimate& estimate) { return fmt::format("{:.3f} [{:.3f}, {:.3f}]", estimate.mean, estimate.low, estimate.high); }
std::string signed_shown(const Estimate& estimate) {
  return fmt::format("{:+.3f} [{:+.3f}, {:+.3f}]", estimate.mean, estimate.low, estimate.high);
}

}  // namespace

Estimate independent_difference(const Estimate& first, const Estimate& second) {
  const double mean = first.mean - second.mean;
  return {mean, mean - std::hypot(first.mean - first.low, second.high - second.mean),
          mean + std::hypot(first.high - first.mean, second.mean - second.low)};
}

std::vector<PrivateScore> private_scores(const std::vector<EvaluationResult>& public_results,
                                         const std::vector<EvaluationResult>& private_results) {
  for (const EvaluationResult& hidden : private_results) {
    if (std::ranges::none_of(public_results, [&](const auto& open) { return open.agent == hidden.agent; }))
      throw InputError(hidden.agent, "has a result on the private set only", "give its result on the public set too");
    if (std::ranges::count(private_results, hidden.agent, &EvaluationResult::agent) > 1)
      throw InputError(hidden.agent, "has more than one result on the private set", "give only one of them");
  }
  std::vector<PrivateScore> scores;
  for (const EvaluationResult& open : public_results) {
    const auto hidden = std::ranges::find(private_results, open.agent, &EvaluationResult::agent);
    if (hidden == private_results.end()) continue;
    if (hidden->policy_hash != open.policy_hash)
      throw InputError(
          open.agent,
          fmt::format("has different policies: '{}' on the public set, '{}' on the private set", open.policy_hash, hidden->policy_hash),
          "evaluate the same policy on both sets");
    PrivateScore score{.agent = open.agent,
                       .public_success = open.success(),
                       .private_success = hidden->success(),
                       .public_spl = open.spl(),
                       .private_spl = hidden->spl(),
                       .success_gap = {},
                       .spl_gap = {}};
    score.success_gap = independent_difference(score.public_success, score.private_success);
    score.spl_gap = independent_difference(score.public_spl, score.private_spl);
    scores.push_back(std::move(score));
  }
  return scores;
}

std::string private_text(const std::vector<PrivateScore>& scores) {
  std::string text =
      fmt::format("{:<20} {:<8} {:<22} {:<22} {:<25} {}\n", "agent", "", "public set", "private set", "public minus private", "");
  for (const PrivateScore& score : scores) {
    const auto line = [&](const char* metric, const Estimate& open, const Estimate& hidden, const Estimate& gap) {
      text += fmt::format("{:<20} {:<8} {:<22} {:<22} {:<25}{}\n", score.agent, metric, shown(open), shown(hidden), signed_shown(gap),
                          gap.low > 0 ? " significantly better on the public set" : "");
    };
    line("success", score.public_success, score.private_success, score.success_gap);
    line("SPL", score.public_spl, score.private_spl, score.spl_gap);
  }
  return text + "mean [95 % interval]\n";
}

}  // namespace earshot
