// SPDX-License-Identifier: Apache-2.0
#include "evaluation/results/verify_result.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <map>
#include <optional>
#include <set>
#include <thread>
#include <tuple>
#include <vector>

#include "evaluation/results/episode_walk.h"
#include "sim/base/engine_hash.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "trainer/run/effective_config.h"

namespace earshot {
namespace {

constexpr const char* kRemedy = "only unchanged results of 'earshot eval --out' on a complete set are accepted";

struct Metric {
  const char* name;
  double (*get)(const EpisodeMetrics&);
};
constexpr Metric kMetrics[] = {{"steps", [](const EpisodeMetrics& m) { return static_cast<double>(m.steps); }},
                               {"stopped", [](const EpisodeMetrics& m) { return m.stopped ? 1.0 : 0.0; }},
                               {"success", [](const EpisodeMetrics& m) { return m.success; }},
                               {"spl", [](const EpisodeMetrics& m) { return m.spl; }},
                               {"soft_spl", [](const EpisodeMetrics& m) { return m.soft_spl; }},
                               {"sna", [](const EpisodeMetrics& m) { return m.sna; }},
                               {"success_when_silent", [](const EpisodeMetrics& m) { return m.success_when_silent; }},
                               {"dtg_m", [](const EpisodeMetrics& m) { return m.dtg_m; }},
                               {"collisions", [](const EpisodeMetrics& m) { return static_cast<double>(m.collisions); }},
                               {"reward", [](const EpisodeMetrics& m) { return m.reward; }}};

bool same_bits(double a, double b) { return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b); }

std::string place(std::size_t index, const EvaluationResult::Row& row) {
  return fmt::format("episode {} ('{}' in {})", index, row.id, row.scene);
}

/// Header of the file.
void check_head(const EvaluationResult& result, const std::string& where, const EpisodeSet& set, const VerifyConfig& config) {
  const auto refuse = [&](const std::string& problem) { throw InputError(where, problem, kRemedy); };
  if (result.engine_hash != engine_hash() && !config.any_engine)
    throw InputError(where, fmt::format("was made by engine {}, but this is engine {}", result.engine_hash, engine_hash()),
                     "make it anew with 'earshot eval', verify it with the build that made it, or add --any-engine, which requires the "
                     "same numbers from this build");
  const std::size_t episodes = result.episodes.size(), whole = set.episodes.size();
  if (episodes > whole) refuse(fmt::format("has {} episodes, but its set has {}", episodes, whole));
  if (episodes == whole && !result.partial_of.empty()) refuse("is marked as partial, but covers all episodes of its set");
  if (episodes < whole && !config.partial) refuse(fmt::format("is partial: it covers {} of the {} episodes of its set", episodes, whole));
}

void check_set_hash(const EvaluationResult& result, const std::string& where, const EpisodeSet& set) {
  const bool partial = result.episodes.size() < set.episodes.size();
  const std::string hash = set_hash_of_first(set, result.episodes.size());
  if (result.set_hash != hash || (partial && result.partial_of != hex64(set.hash)))
    throw InputError(where, fmt::format("belongs to the set {}, but these episodes are {}", result.set_hash, hash), kRemedy);
}

/// Rows are the episodes of the set, in its order.
void check_order(const EvaluationResult& result, const std::string& where, const EpisodeSet& set) {
  std::set<std::tuple<std::string, std::string>> in_set, seen;
  bool unique = true;  // sets from elsewhere may name episodes alike
  for (const Episode& episode : set.episodes) unique = in_set.emplace(episode.scene_id, episode.episode_id).second && unique;
  for (std::size_t i = 0; i < result.episodes.size(); ++i) {
    const EvaluationResult::Row& row = result.episodes[i];
    const Episode& episode = set.episodes[i];
    const auto refuse = [&](const std::string& problem) { throw InputError(where, place(i, row) + " " + problem, kRemedy); };
    if (!seen.emplace(row.scene, row.id).second && unique) refuse("occurs twice");
    if (row.id != episode.episode_id || row.scene != episode.scene_id)
      refuse(fmt::format("is at the place of '{}' in {} of the set", episode.episode_id, episode.scene_id));
    if (row.sound != episode.sound) refuse(fmt::format("lists its sound as '{}', but the set has '{}'", row.sound, episode.sound));
  }
}

void check_rules(const EvaluationResult& result, const std::string& where, const MetricRules& rules) {
  if (result.rules.empty()) return;
  const auto changes = config_changes(result.rules, rules);
  if (changes.empty()) return;
  throw InputError(
      where, fmt::format("was run with {} = {}, but the rules have {}", changes.front().key, changes.front().before, changes.front().now),
      kRemedy);
}

/// The summary is a function of the episodes: the same bits.
void check_summary(const EvaluationResult& result, const std::string& where) {
  for (const auto& [name, estimate] : result.summary()) {
    const auto claimed = result.claimed_summary.find(name);
    const bool is_equal = claimed != result.claimed_summary.end() && same_bits(claimed->second.mean, estimate.mean) &&
                          same_bits(claimed->second.low, estimate.low) && same_bits(claimed->second.high, estimate.high);
    if (!is_equal) throw InputError(where, fmt::format("has a summary whose '{}' does not match its episodes", name), kRemedy);
  }
  if (result.claimed_episodes != result.episodes.size())
    throw InputError(where, "has a summary for a different number of episodes than it contains", kRemedy);
}

/// The fault of a row, or empty.
std::string fault_of(const EvaluationResult::Row& row, const WalkOutcome& walked) {
  if (!walked.fault.empty()) return walked.fault;
  for (const Metric& metric : kMetrics) {
    const double claimed = metric.get(row.metrics), now = metric.get(walked.metrics);
    if (!same_bits(claimed, now)) return fmt::format("reports {} = {}, but its actions give {}", metric.name, claimed, now);
  }
  return {};
}

/// The first row that is not what its actions give, and why.
struct FirstFault {
  std::size_t index;
  std::string problem;
  bool is_walked = true;  ///< else the scene or the sound could not be loaded
};

/// Toolchains round differently: a number of another toolchain proves neither a forgery nor the actions.
[[noreturn]] void refuse_row(const EvaluationResult& result, const std::string& where, const FirstFault& fault) {
  const std::string problem = place(fault.index, result.episodes[fault.index]) + " " + fault.problem;
  const std::string made = walking_toolchain(result.toolchain), here = walking_toolchain(simulation_toolchain());
  if (!fault.is_walked || made == here || result.engine_hash == engine_hash()) throw InputError(where, problem, kRemedy);
  throw InputError(
      where, fmt::format("{}; it was made with {}, and verified with {}", problem, made.empty() ? "an unknown toolchain" : made, here),
      "verify it with the same toolchain: toolchains round differently, so this difference alone does not prove a forgery");
}

/// Episodes of the scenes are walked by the threads, a scene by one of them.
std::optional<FirstFault> first_fault(const EvaluationResult& result, const EpisodeSet& set, const RuledEnv& ruled, int threads) {
  std::map<std::string, std::vector<std::size_t>> of_scene;
  for (std::size_t i = 0; i < result.episodes.size(); ++i) of_scene[set.episodes[i].scene_id].push_back(i);
  std::vector<const std::vector<std::size_t>*> parts;
  for (const auto& [scene, rows] : of_scene) parts.push_back(&rows);
  std::vector<std::optional<FirstFault>> faults(parts.size());
  std::atomic<std::size_t> next{0};
  const auto walk = [&] {
    for (std::size_t part = next++; part < parts.size(); part = next++) {
      std::size_t index = parts[part]->front();
      try {
        const WalkedScene scene = load_walked_scene(set.episodes[index].scene_id, ruled.env);
        std::map<std::tuple<double, double, double>, GeodesicField> fields;
        for (const std::size_t i : *parts[part]) {
          index = i;
          const Episode& episode = set.episodes[i];
          const glm::dvec3 at = episode.goal_position;
          const std::tuple key(at.x, at.y, at.z);
          auto field = fields.find(key);
          if (field == fields.end()) field = fields.emplace(key, GeodesicField(scene.navmesh, scene.scene->to_local(at))).first;
          const auto envs = static_cast<std::size_t>(ruled.num_envs);
          const WalkOutcome walked = walk_episode(ruled.env, scene, field->second, episode, result.episodes[i].actions,
                                                  static_cast<std::uint32_t>(i % envs), static_cast<std::uint32_t>(i / envs));
          if (std::string problem = fault_of(result.episodes[i], walked); !problem.empty()) {
            faults[part] = {.index = i, .problem = std::move(problem)};
            break;
          }
        }
      } catch (const std::exception& error) {
        faults[part] = {.index = index, .problem = error.what(), .is_walked = false};
      }
    }
  };
  const auto cores = std::max(1u, std::thread::hardware_concurrency());
  const std::size_t wanted = threads > 0 ? static_cast<std::size_t>(threads) : cores;
  {
    std::vector<std::jthread> helpers;
    for (std::size_t i = 1; i < std::min(wanted, parts.size()); ++i) helpers.emplace_back(walk);
    walk();
  }
  std::optional<FirstFault> first;
  for (auto& fault : faults)
    if (fault && (!first || fault->index < first->index)) first = std::move(fault);
  return first;
}

}  // namespace

Verification verify_result(const EvaluationResult& result, const std::string& where, const EpisodeSet& set, const MetricRules& rules,
                           const VerifyConfig& config) {
  if (!result.matches_checksum) throw InputError(where, "was changed after it was written: the checksum does not match", kRemedy);
  if (result.episodes.empty()) throw InputError(where, "contains no episodes", kRemedy);
  check_head(result, where, set, config);
  check_order(result, where, set);
  check_set_hash(result, where, set);
  check_rules(result, where, rules);
  const RuledEnv ruled = env_of_rules(rules, where, config.scene_root, config.sound_root);
  if (const auto fault = first_fault(result, set, ruled, config.threads)) refuse_row(result, where, *fault);
  check_summary(result, where);
  Verification verified{.episodes = result.episodes.size(),
                        .steps = 0,
                        .partial = result.episodes.size() < set.episodes.size(),
                        .same_engine = result.engine_hash == engine_hash(),
                        .toolchain = walking_toolchain(result.toolchain)};
  for (const auto& row : result.episodes) verified.steps += row.actions.size();
  return verified;
}

}  // namespace earshot
