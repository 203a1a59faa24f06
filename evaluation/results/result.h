// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "envs/episodes/episode_set.h"
#include "envs/task/av_nav_task.h"
#include "evaluation/results/sensed_config.h"
#include "trainer/run/toolchain.h"

namespace earshot {

/// Mean of a metric over episodes with its 95 % interval.
struct Estimate {
  double mean = 0, low = 0, high = 0;
};
/// values: one per episode.  An empty list gives zeros; one value gives an interval of zero width.
Estimate mean_with_interval(const std::vector<double>& values);
/// The mean over all values, and the interval of a bootstrap over groups (Davison and Hinkley 1997, section 3.8): episodes in one house are
/// not independent, houses are.  2,000 samples of as many groups as there are, drawn with replacement, a function of the input;
/// percentiles, widened by sqrt(G / (G - 1)) about the mean, as G groups show too little of their spread.  groups [values]: at least two
/// different ones.
Estimate mean_with_group_interval(std::span<const double> values, std::span<const int> groups);
/// Wilson score interval of `hits` out of `n` (Wilson 1927).
Estimate fraction_with_interval(std::uint64_t hits, std::uint64_t n);

/// Where a verified result stands on the board of a benchmark.
struct Standing {
  std::string track;     ///< the first track of the benchmark with all sensors that the agent reads; kAnything: none has them
  std::string rests_on;  ///< what shows that the agent chose its actions
  std::string apart;     ///< why it has no rank; empty: it is ranked among those of its track
};
/// Track of agents that read what no track of a benchmark has.
inline constexpr const char* kAnything = "anything";

/// One evaluated agent: what `eval --out` writes, `leaderboard` reads and `verify` checks.
struct EvaluationResult {
  std::string agent;  ///< name in the table
  std::string policy_hash, engine_hash;
  std::string set_hash;         ///< of the episodes that were run
  std::string partial_of = {};  ///< hash of the set that these are the first episodes of; empty: they are a whole set
  std::string episodes_file;
  std::uint64_t seed = 0;
  struct Row {
    std::string id, scene;
    EpisodeMetrics metrics;
    std::vector<std::int8_t> actions;
    std::string sound = {};    ///< of the goal, as Episode::sound; empty in older files
    std::string novelty = {};  ///< what it was to the training: see note_novelty; empty where that is not known
    /// From the set (note_places), not in a file: floor of the scene, and walking distance to the goal; 0 if unknown.
    double area_m2 = 0, distance_m = 0;
  };
  std::vector<Row> episodes;                      ///< in the order of the set
  std::string baseline = {};                      ///< name of the agent without learning that was run; empty: a policy
  SensedConfig senses = {};                       ///< what the agent sensed by (sensed_config.h); empty in older files
  std::string track = {};                         ///< kAnything where it was asked to be taken as such
  std::map<std::string, std::string> rules = {};  ///< by which metrics were made (metric_rules.h); empty in older files
  Toolchain toolchain = {};                       ///< of the program that ran the episodes; empty in older files

  /// Of a file that was read: what it says of itself, which may not be so.
  std::map<std::string, Estimate> claimed_summary = {};
  std::uint64_t claimed_episodes = 0;
  bool matches_checksum = true;           ///< its checksum matches the rest, or is absent (older files)
  bool verified = false;                  ///< set where it was, in this process; no file says it
  std::optional<Standing> standing = {};  ///< the same

  /// Whether intervals are those of a bootstrap over scenes, or of episodes where those are wider; with fewer than kMinScenes they are of
  /// episodes: Wilson's for fractions, else Student's t.
  [[nodiscard]] bool intervals_over_scenes() const;
  static constexpr std::size_t kMinScenes = 5;
  [[nodiscard]] Estimate success() const;
  [[nodiscard]] Estimate spl() const;
  [[nodiscard]] Estimate soft_spl() const;
  [[nodiscard]] Estimate sna() const;
  [[nodiscard]] Estimate success_when_silent() const;
  [[nodiscard]] Estimate dtg_m() const;
  [[nodiscard]] Estimate steps() const;
  [[nodiscard]] Estimate collisions() const;
  /// The agent as tables name it: a baseline cannot pass for something else by its name.
  [[nodiscard]] std::string shown_agent() const;
  /// All of these by their names in files, in the order of files.
  [[nodiscard]] std::vector<std::pair<std::string, Estimate>> summary() const;
};

void save_result(const EvaluationResult& result, const std::filesystem::path& path);
/// Largest file of a result: an honest one of benchmark `standard` has at most 2 MB.
inline constexpr std::size_t kMaxResultBytes = std::size_t{32} << 20;
/// Throws InputError: missing, not a regular file, over kMaxResultBytes or with more numbers, texts and lists than such a file has
/// (json_size.h), not JSON, a key missing or mistyped, control characters in a text.  Takes at most 300 MB.
EvaluationResult load_result(const std::filesystem::path& path);

/// EvaluationResult::set_hash of a result of the first `episodes` episodes of a set, at most all of them.
std::string set_hash_of_first(const EpisodeSet& set, std::size_t episodes);

}  // namespace earshot
