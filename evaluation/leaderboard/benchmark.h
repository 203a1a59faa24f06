// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "envs/episodes/episode_set.h"
#include "evaluation/leaderboard/tracks.h"
#include "evaluation/results/verify_result.h"
#include "trainer/run/run_config.h"

namespace earshot {

/// A task that agents are ranked on: a run config (rules in env, the test set in data.eval, the training data in data.train) with a
/// section `benchmark` that fixes it.
struct Benchmark {
  std::string name;
  int version = 1;          ///< another one whenever set or rules change
  std::string set_hash;     ///< EpisodeSet::hash of the test set, as hex64
  std::string rules_hash;   ///< of what metrics depend on (metric_rules), as hex64
  std::string senses_hash;  ///< of what agents sense by (sensed_config) and of the tracks, as hex64
  std::uint64_t seed = 0;   ///< of sampled actions (`eval --seed`)
  /// Sounds of the test set that may occur in training too, so that results on known and on new sounds can be compared.
  std::vector<std::string> heard_sounds = {};
  /// Kinds of sound (sound_kind) of the test set that do not occur in training.
  std::vector<std::string> held_out_kinds = {};
  std::vector<Track> tracks = default_tracks();
  std::string content_sha256 = {};  ///< of the files of scenes and sounds that the test set names (digest_of_content); empty: it names none
  std::string private_sha256 = {};  ///< of the file of a second set that is not published (private_set.h); empty: there is none
  RunConfig run;
};

/// Throws InputError: the file is missing or a key is, is unknown, or its rules or senses are others than its hashes say.
/// overrides: "key=value" of the run config; none but what a machine may have its own: folders, threads, sizes of caches and of the
/// batch (is_local_key).  Throws InputError that names a key that the benchmark fixes.
Benchmark load_benchmark(const std::filesystem::path& path, const std::vector<std::string>& overrides = {});
/// Reads the section `benchmark` of a file, tracks apart; its other sections are those of a run config.  Throws InputError.
void read(ConfigReader& file, Benchmark& benchmark);
/// XXH3 of the rules' text.
std::string hash_of_rules(const MetricRules& rules);
/// The same of what agents sense by, and of the tracks.
std::string hash_of_senses(const SensedConfig& senses, const std::vector<Track>& tracks);

/// The test set in the file that data.eval names, which is made first where it is missing.  Throws InputError if its hash is
/// another, or that of the files of its scenes and sounds.
EpisodeSet benchmark_set(const Benchmark& benchmark);

/// Looks for scenes and sounds of the training in the test set: by name, houses and floors by their seed whatever their other keys,
/// synthetic sounds by kind and seed, files of sound by their samples, and near-duplicates of scenes by their geometry (geometry_overlap).
/// heard_sounds are let through, and must be of both; held_out_kinds must be of the test set alone.
/// Throws InputError with the first that is found.  Loads every scene and sound: milliseconds each.
void check_splits(const Benchmark& benchmark);

/// Throws InputError: a sound of held_out_kinds is among the trained, or a kind of them among none of the tested.
void check_held_out_kinds(const Benchmark& benchmark, const std::vector<std::string>& trained, const std::vector<std::string>& tested);

/// verify_result by the rules of the benchmark, its seed, and what its training heard (Row::novelty).
Verification verify_for_benchmark(const EvaluationResult& result, const std::string& where, const Benchmark& benchmark,
                                  const EpisodeSet& set, const VerifyConfig& config);

}  // namespace earshot
