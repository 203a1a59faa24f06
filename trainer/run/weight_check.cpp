// SPDX-License-Identifier: Apache-2.0
#include "trainer/run/weight_check.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <system_error>

#include "trainer/run/effective_config.h"

namespace earshot {
namespace {

std::optional<double> number_in(const std::string& text) {
  double number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc() || end != text.data() + text.size() || !(number > 0)) return std::nullopt;
  return number;
}

}  // namespace

std::optional<std::string> fault_of_weights(const PolicyNetwork& policy) {
  const torch::NoGradGuard no_gradients;
  for (const auto& item : policy->named_parameters()) {
    const double largest = item.value().numel() == 0 ? 0.0 : item.value().abs().max().item<double>();  // NaN where one is
    if (!std::isfinite(largest)) return fmt::format("{} is not finite", item.key());
    if (largest > kMaxOfAWeight) return fmt::format("{} has grown to {:.3g}", item.key(), largest);
  }
  return std::nullopt;
}

std::string suspect_key(const RunConfig& config) {
  const auto now = flat_config(config_text(config)), usual = flat_config(config_text(RunConfig()));
  std::string key = "ppo.learning_rate";
  double furthest = 1;  // power of ten
  for (const auto& [name, text] : now) {
    // SIGALRM changes nothing, and a number of passes is not a rate.
    if ((!name.starts_with("ppo.") && !name.starts_with("guidance.")) || name.ends_with("_alarm") || name.starts_with("ppo.preempt"))
      continue;
    const auto before = usual.find(name);
    if (before == usual.end()) continue;
    const auto value = number_in(text), standard = number_in(before->second);
    if (!value || !standard) continue;
    const double distance = std::abs(std::log10(*value / *standard));
    if (distance < furthest) continue;
    furthest = distance;
    key = name;
  }
  return fmt::format("{} = {:g} (default {:g})", key, number_in(now.at(key)).value_or(0), number_in(usual.at(key)).value_or(0));
}

}  // namespace earshot
