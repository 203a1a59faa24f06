// SPDX-License-Identifier: Apache-2.0
#include "trainer/run/effective_config.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <filesystem>
#include <system_error>

#include "sim/audio/head/layout_file.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/regular_file.h"
#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

/// Whether `key` is `name` or lies in the section of that name.
bool lies_in(std::string_view key, std::string_view name) {
  return key.starts_with(name) && (key.size() == name.size() || key[name.size()] == '.');
}

/// 0.15 for the float 0.150000006; other text as it is.
std::string readable(const std::string& value) {
  double number = 0;
  const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), number);
  const bool fraction = error == std::errc() && end == value.data() + value.size() && value.find_first_of(".e") != std::string::npos;
  return fraction ? fmt::format("{:.6g}", number) : value;
}

/// Responses of heads with thousands of directions take some tens of MB.
constexpr std::size_t kMaxEarBytes = std::size_t{1} << 30;

/// Files of microphones, of their patterns and of a head.
std::vector<std::filesystem::path> files_of_ears(const EnvConfig& env) {
  std::vector<std::filesystem::path> files;
  if (names_file(env.observation.channels)) files = env.observation.layout().files;
  if (!env.hrtf.empty()) files.emplace_back(env.hrtf);
  return files;
}

}  // namespace

std::map<std::string, std::string> flat_config(const std::string& yaml) { return ConfigReader::from_text(yaml, "config").flat(); }

std::vector<ConfigChange> config_changes(const std::map<std::string, std::string>& before, const std::map<std::string, std::string>& now) {
  const auto value_of = [](const std::map<std::string, std::string>& flat, const std::string& key) {
    const auto found = flat.find(key);
    return found == flat.end() ? std::string("(absent)") : found->second;
  };
  std::map<std::string, std::string> all = before;
  all.insert(now.begin(), now.end());
  std::vector<ConfigChange> changes;
  for (const auto& [key, unused] : all) {
    ConfigChange change{key, value_of(before, key), value_of(now, key)};
    if (change.before == change.now) continue;
    if (readable(change.before) != readable(change.now)) {
      change.before = readable(change.before);
      change.now = readable(change.now);
    }
    changes.push_back(std::move(change));
  }
  return changes;
}

bool is_free_to_change(std::string_view key, const RunConfig& now) {
  // What is only reported, where files lie, how long and on how many threads: the weights have the same bits.  The training set itself is
  // bound by its hash in the checkpoint, a module by that in its architecture, the number of workers by the checkpoint's.
  constexpr std::array<std::string_view, 27> free{"name",
                                                  "metrics_file",
                                                  "network",
                                                  "out",
                                                  "workers",
                                                  "eval_actions",
                                                  "checkpoint_every",
                                                  "keep",
                                                  "eval_envs",
                                                  "data.eval",
                                                  "held_out",
                                                  "data.held_out",
                                                  "env.threads",
                                                  "env.prefetch",
                                                  "env.acoustics.threads",
                                                  "env.scene_cache_gb",
                                                  "env.field_store",
                                                  "env.field_store_gb",
                                                  "env.scene_store",
                                                  "env.scene_store_gb",
                                                  "env.quarantine_dir",
                                                  "env.order",
                                                  "data.train.file",
                                                  "ppo.roll_backs",
                                                  "ppo.loss_alarm",
                                                  "ppo.kl_alarm",
                                                  "policy.module"};
  if (std::ranges::any_of(free, [&](std::string_view name) { return lies_in(key, name); })) return true;
  if (key == "max_minutes") return now.schedule == Schedule::steps;
  const PpoConfig& ppo = now.ppo;
  const bool schedules = ppo.linear_learning_rate_decay || ppo.linear_clip_decay || ppo.linear_entropy_decay ||
                         now.guidance.imitation != now.guidance.imitation_end_weight || now.guidance.oracle > 0;
  return key == "total_steps" && !schedules;
}

std::string common_settings(const RunConfig& config) {
  // Free for a run that goes on, but not within one: they say when all workers make which calls.
  constexpr std::array<std::string_view, 4> bound{"total_steps", "max_minutes", "checkpoint_every", "ppo.roll_backs"};
  const auto is_bound = [&](const std::string& key) {
    if (config.held_out.is_on() && (lies_in(key, "held_out") || key == "eval_envs" || key == "eval_actions")) return true;
    return std::ranges::find(bound, key) != bound.end() || !is_free_to_change(key, config);
  };
  std::string lines;
  for (const auto& [key, value] : flat_config(config_text(config)))
    if (is_bound(key)) lines += fmt::format("{}={}\n", key, value);
  if (!config.policy.module.empty())
    lines += fmt::format("module={}\n", hex64(hash64(read_regular_file(config.policy.module, kMaxModuleBytes))));
  for (const auto& file : files_of_ears(config.env))
    lines += fmt::format("{}={}\n", file.string(), hex64(hash64(read_regular_file(file, kMaxEarBytes))));
  if (!config.train.file.empty()) lines += fmt::format("training set={}\n", hex64(hash64(read_file(config.train.file))));
  if (config.held_out.is_on()) lines += fmt::format("held-out set={}\n", hex64(hash64(read_file(config.held_out_data.file))));
  return lines;
}

RunConfig parse_effective_config(const std::string& yaml, const std::string& where, const std::vector<std::string>& overrides) {
  for (const auto& text : overrides)
    for (const char* key : {"env.acoustics.preset", "seed"})
      if (text.starts_with(std::string(key) + "="))
        throw InputError("override '" + text + "'",
                         "sets several keys at once, which is not possible for a checkpoint: it contains the value of every key",
                         "override the keys one by one");
  return parse_run_config(yaml, where, overrides);
}

RunConfig config_of_checkpoint(const CheckpointMetadata& checkpoint, const std::string& where, const std::vector<std::string>& overrides) {
  std::vector<std::string> all;
  if (checkpoint.is_policy)
    all = {"env.field_store=\"\"", "env.scene_store=\"\"", "env.quarantine_dir=\"\"", "metrics_file=\"\"", "out=\"runs/run\""};
  all.insert(all.end(), overrides.begin(), overrides.end());
  return parse_effective_config(checkpoint.config_yaml, where + " (its config)", all);
}

}  // namespace earshot
