// SPDX-License-Identifier: Apache-2.0
#include "evaluation/results/metric_rules.h"

#include <charconv>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"
#include "trainer/run/effective_config.h"

namespace earshot {
namespace {

constexpr const char* kHears = "hears";
constexpr const char* kEnvs = "envs";

bool counts(const std::string& key) {
  return key.starts_with("task.") || key.starts_with("navmesh.") || key == "seed" || key == "agents" || key == "acoustics.sample_rate_hz";
}

}  // namespace

MetricRules metric_rules(const EnvConfig& env, int num_envs) {
  MetricRules rules = flat_config(config_text(env));
  std::erase_if(rules, [](const auto& rule) { return !counts(rule.first); });
  rules[kHears] = env.observation.hears() ? "true" : "false";
  rules[kEnvs] = std::to_string(num_envs);
  return rules;
}

MetricRules rules_for(const MetricRules& of_result, const MetricRules& of_benchmark) {
  MetricRules rules = of_benchmark;
  std::vector<std::string> free{"task.step_reward", "task.distance_reward", "task.success_reward", "acoustics.sample_rate_hz", kHears};
  if (!env_of_rules(of_benchmark, "the benchmark").env.task.actuation_noise.any()) free.insert(free.end(), {"seed", kEnvs});
  for (const std::string& key : free)
    if (const auto found = of_result.find(key); found != of_result.end()) rules[key] = found->second;
  return rules;
}

RuledEnv env_of_rules(const MetricRules& rules, const std::string& where, const std::string& scene_root, const std::string& sound_root) {
  const auto refuse = [&](const std::string& problem) {
    throw InputError(where, problem, "evaluate the agent again with this program, or give the config of the benchmark");
  };
  RuledEnv ruled;
  std::vector<std::string> keys;
  bool hears = false;
  for (const auto& [key, value] : rules) {
    if (key == kHears) {
      if (value != "true" && value != "false") refuse("has a rule 'hears' that is not true or false");
      hears = value == "true";
    } else if (key == kEnvs) {
      const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), ruled.num_envs);
      if (error != std::errc() || end != value.data() + value.size() || ruled.num_envs < 1)
        refuse("has a rule 'envs' that is not a number");
    } else if (counts(key)) {
      keys.push_back(key + "=" + value);
    } else {
      refuse("has a rule '" + key + "' that does not affect any metric");
    }
  }
  for (const auto& [key, unused] : metric_rules(ruled.env, 1))
    if (!rules.contains(key)) refuse("does not contain the rule '" + key + "'");
  ConfigReader reader = ConfigReader::from_text("", where + " (its rules)", keys);
  read(reader, ruled.env);
  reader.finish();
  ObservationSpec& observation = ruled.env.observation;
  observation.depth = false;
  observation.pointgoal = true;  // an environment has some sensor
  observation.spectrogram = hears;
  ruled.env.scene_root = scene_root;
  ruled.env.sound_root = sound_root;
  validate(ruled.env);
  if (ruled.env.agents != 1) refuse("has several agents per environment, which cannot be verified");
  return ruled;
}

}  // namespace earshot
