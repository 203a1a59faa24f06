#include "trainer/learner/guidance_config.h"

#include <algorithm>
#include <cmath>

#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

/// From `first` to `last` by the time that `until` of the training is over.
double falling(double first, double last, double until, double progress) {
  if (until <= 0) return last;
  return last + (first - last) * std::max(0.0, 1.0 - progress / until);
}

}  // namespace

double GuidanceConfig::imitation_at(double progress) const { return falling(imitation, imitation_end_weight, imitation_until, progress); }

double GuidanceConfig::oracle_at(double progress) const { return falling(oracle, 0, oracle_until, progress); }

void read(ConfigReader& reader, GuidanceConfig& config) {
  reader.read("imitation", config.imitation);
  reader.read("imitation_end_weight", config.imitation_end_weight);
  reader.read("imitation_until", config.imitation_until);
  reader.read("oracle", config.oracle);
  reader.read("oracle_until", config.oracle_until);
  reader.read("goal", config.goal);
}

void validate(const GuidanceConfig& config) {
  const auto weight = [](const char* key, double value) {
    require(value >= 0 && std::isfinite(value), key, value, "must not be negative: it is the weight of a loss");
  };
  const auto fraction = [](const char* key, double value, const char* why) { require(value >= 0 && value <= 1, key, value, why); };
  weight("guidance.imitation", config.imitation);
  weight("guidance.imitation_end_weight", config.imitation_end_weight);
  weight("guidance.goal", config.goal);
  fraction("guidance.imitation_until", config.imitation_until, "must be in [0, 1]: a fraction of the training");
  fraction("guidance.oracle", config.oracle, "must be in [0, 1]: a fraction of the episodes");
  fraction("guidance.oracle_until", config.oracle_until, "must be in [0, 1]: a fraction of the training");
  require(config.imitation == 0 || config.imitation_until > 0, "guidance.imitation_until", config.imitation_until,
          "must be positive: otherwise guidance.imitation ends before it begins");
  require(config.oracle == 0 || config.imitation > 0, "guidance.oracle", config.oracle,
          "has no effect without guidance.imitation: the oracle's steps are used for imitation only");
  require(config.oracle == 0 || config.oracle_until > 0, "guidance.oracle_until", config.oracle_until,
          "must be positive: otherwise guidance.oracle ends before it begins");
  require(config.oracle == 0 || config.oracle_until <= config.imitation_until || config.imitation_end_weight > 0, "guidance.oracle_until",
          config.oracle_until, "must not exceed guidance.imitation_until: later steps of the oracle would not be imitated");
}

}  // namespace earshot
