// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace earshot {

class ConfigReader;

/// When a run evaluates its weights on held-out episodes (data.held_out), and what follows.  Off by default: it takes time and a set.
struct HeldOutConfig {
  int every_updates = 0;  ///< from one evaluation to the next; 0: none
  /// Largest part of the evaluations in all environment steps of the run, theirs included; with `schedule: minutes` in its wall time.  The
  /// next one waits until it fits; the first does not wait.
  double max_fraction = 0.1;
  int patience = 0;  ///< evaluations in a row without a better one after which the run ends; 0: any number

  [[nodiscard]] bool is_on() const { return every_updates > 0; }
};
void read(ConfigReader& reader, HeldOutConfig& config);
/// Throws InputError naming the key, its value and the rule.
void validate(const HeldOutConfig& config);

}  // namespace earshot
