// SPDX-License-Identifier: Apache-2.0
#include "trainer/curves/update_curves.h"

namespace earshot {

std::vector<std::pair<std::string, double>> update_curves(const EpisodeSums& recent, const UpdateStats& stats, const StageTimes& times,
                                                          double steps_per_s, const GuidanceConfig& guidance, double progress) {
  std::vector<std::pair<std::string, double>> values{
      {"episodes/success", recent.mean(EpisodeSums::success)},
      {"episodes/spl", recent.mean(EpisodeSums::spl)},
      {"episodes/soft_spl", recent.mean(EpisodeSums::soft_spl)},
      {"episodes/sna", recent.mean(EpisodeSums::sna)},
      {"episodes/dtg_m", recent.mean(EpisodeSums::dtg)},
      {"episodes/reward", recent.mean(EpisodeSums::reward)},
      {"episodes/steps", recent.mean(EpisodeSums::steps)},
      {"episodes/collisions", recent.mean(EpisodeSums::collisions)},
      {"episodes/stopped", recent.mean(EpisodeSums::stopped)},
      {"episodes/false_stop", recent.mean(EpisodeSums::stopped) - recent.mean(EpisodeSums::success)},
      {"episodes/timeout", 1 - recent.mean(EpisodeSums::stopped)},
      {"policy/loss", stats.policy_loss},
      {"policy/value_loss", stats.value_loss},
      {"policy/entropy", stats.entropy},
      {"policy/approx_kl", stats.approx_kl},
      {"policy/clip_fraction", stats.clip_fraction},
      {"policy/gradient_norm", stats.gradient_norm},
      {"policy/explained_variance", stats.explained_variance},
      {"policy/epochs", static_cast<double>(stats.epochs)},
      {"policy/skipped_steps", static_cast<double>(stats.skipped_steps)},
      {"policy/max_ratio_error", stats.max_ratio_error},
      {"time/steps_per_s", steps_per_s},
      {"time/simulate_sound_s", times.simulate_sound},
      {"time/convolve_s", times.convolve},
      {"time/render_s", times.render},
      {"time/move_s", times.move},
      {"time/policy_s", times.policy},
      {"time/learn_s", times.learn},
      {"time/reduce_s", times.reduce}};
  if (guidance.imitation_at(progress) > 0) {
    values.emplace_back("guidance/imitation_loss", stats.imitation_loss);
    values.emplace_back("guidance/oracle_agreement", stats.oracle_agreement);
  }
  if (guidance.goal > 0) values.emplace_back("guidance/goal_loss", stats.goal_loss);
  return values;
}

std::vector<std::pair<std::string, double>> held_out_curves(const HeldOutScores& scores, const HeldOutState& state, double elapsed_s) {
  std::vector<std::pair<std::string, double>> values;
  const auto add = [&](const std::string& name, const HeldOutEstimate& estimate) {
    values.emplace_back("held_out/" + name, estimate.mean);
    values.emplace_back("held_out/" + name + "_low", estimate.low);
    values.emplace_back("held_out/" + name + "_high", estimate.high);
  };
  add("argmax_success", scores.argmax.success);
  add("argmax_spl", scores.argmax.spl);
  add("sample_success", scores.sample.success);
  add("sample_spl", scores.sample.spl);
  values.emplace_back("held_out/best_update", static_cast<double>(state.best_update));
  values.emplace_back("held_out/best_success", state.best.success.mean);
  values.emplace_back("held_out/since_best", static_cast<double>(state.since_best));
  values.emplace_back("held_out/env_steps", static_cast<double>(scores.env_steps));
  values.emplace_back("held_out/evaluate_s", scores.seconds);
  values.emplace_back("held_out/time_fraction", elapsed_s > 0 ? state.seconds / elapsed_s : 0);
  return values;
}

}  // namespace earshot
