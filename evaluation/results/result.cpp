// SPDX-License-Identifier: Apache-2.0
#include "evaluation/results/result.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <numeric>
#include <set>
#include <string_view>

#include "envs/baselines/baselines.h"
#include "envs/task/action.h"
#include "sim/base/control_characters.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/random.h"
#include "sim/base/regular_file.h"
#include "sim/base/text/json.h"
#include "sim/base/text/json_depth.h"
#include "sim/base/text/json_number.h"
#include "sim/base/text/json_size.h"
#include "sim/base/text/schema_version.h"

namespace earshot {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kUnbounded = std::numeric_limits<double>::infinity();

/// 97.5 % point of Student's t, from the expansion of Abramowitz and Stegun 26.7.5 in 1/degrees: within 0.3 % from 3 degrees on.
double student_t975(double degrees) {
  const double z = 1.959963985, z3 = z * z * z, z5 = z3 * z * z, z7 = z5 * z * z;
  return z + (z3 + z) / (4 * degrees) + (5 * z5 + 16 * z3 + 3 * z) / (96 * degrees * degrees) +
         (3 * z7 + 19 * z5 + 17 * z3 - 15 * z) / (384 * degrees * degrees * degrees);
}

/// The scene of each episode by number, in order of first appearance.
std::vector<int> scene_numbers(const std::vector<EvaluationResult::Row>& rows) {
  std::map<std::string, int> numbers;
  std::vector<int> scenes;
  scenes.reserve(rows.size());
  for (const auto& row : rows) scenes.push_back(numbers.emplace(row.scene, static_cast<int>(numbers.size())).first->second);
  return scenes;
}

Estimate wider(const Estimate& a, const Estimate& b) { return {a.mean, std::min(a.low, b.low), std::max(a.high, b.high)}; }

/// Of a metric in [0, most].  Never narrower than if episodes were independent: scenes that happen to agree show no spread at all.
template <class Get>
Estimate over(const EvaluationResult& result, double most, Get get) {
  std::vector<double> values;
  values.reserve(result.episodes.size());
  for (const auto& row : result.episodes) values.push_back(static_cast<double>(get(row.metrics)));
  Estimate estimate = mean_with_interval(values);
  if (result.intervals_over_scenes()) estimate = wider(estimate, mean_with_group_interval(values, scene_numbers(result.episodes)));
  return {estimate.mean, std::max(0.0, estimate.low), std::min(most, estimate.high)};
}

template <class Get>
Estimate fraction_over(const EvaluationResult& result, Get get) {
  std::vector<double> hit;
  std::uint64_t hits = 0;
  for (const auto& row : result.episodes) {
    hit.push_back(get(row.metrics) > 0.5 ? 1.0 : 0.0);
    hits += get(row.metrics) > 0.5 ? 1 : 0;
  }
  Estimate estimate = fraction_with_interval(hits, result.episodes.size());
  if (result.intervals_over_scenes()) estimate = wider(estimate, mean_with_group_interval(hit, scene_numbers(result.episodes)));
  return {estimate.mean, std::max(0.0, estimate.low), std::min(1.0, estimate.high)};
}

/// Of the file's format; files without it are older.
constexpr int kResultVersion = 2;

/// XXH3 of everything else in the file, whatever the order of keys and blanks.  Tells that a file was damaged or edited; whoever makes a
/// false one can make its checksum too.
/// rest: without the checksum.
std::string checksum_of(const nlohmann::json& rest) { return hex64(hash64(json_text_of_any_bytes(rest))); }

Json to_json(const Estimate& estimate) { return {{"mean", estimate.mean}, {"low", estimate.low}, {"high", estimate.high}}; }

}  // namespace

Estimate mean_with_interval(const std::vector<double>& values) {
  const auto n = static_cast<double>(values.size());
  if (values.empty()) return {};
  double sum = 0;
  for (const double value : values) sum += value;
  const double mean = sum / n;
  if (values.size() == 1) return {mean, mean, mean};
  double square = 0;
  for (const double value : values) square += (value - mean) * (value - mean);
  const double half = student_t975(n - 1) * std::sqrt(square / (n - 1) / n);
  return {mean, mean - half, mean + half};
}

Estimate mean_with_group_interval(std::span<const double> values, std::span<const int> groups) {
  EARSHOT_EXPECT(values.size() == groups.size());
  std::map<int, std::size_t> numbers;
  std::vector<double> sums, counts;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::size_t group = numbers.emplace(groups[i], numbers.size()).first->second;
    if (group == sums.size()) {
      sums.push_back(0);
      counts.push_back(0);
    }
    sums[group] += values[i];
    counts[group] += 1;
  }
  EARSHOT_EXPECT(sums.size() >= 2);
  const double mean = std::accumulate(sums.begin(), sums.end(), 0.0) / static_cast<double>(values.size());
  const auto num_groups = static_cast<std::uint32_t>(sums.size());
  const double widening = std::sqrt(static_cast<double>(num_groups) / static_cast<double>(num_groups - 1));
  constexpr std::size_t samples = 2000;
  std::vector<double> means(samples);
  for (std::size_t sample = 0; sample < samples; ++sample) {
    const RandomStream random(0, Purpose::bootstrap, static_cast<std::uint32_t>(sample));
    double sum = 0, count = 0;
    for (std::uint32_t draw = 0; draw < num_groups; ++draw) {
      const std::size_t group = random.below(num_groups, draw);
      sum += sums[group];
      count += counts[group];
    }
    means[sample] = mean + widening * (sum / count - mean);
  }
  std::ranges::sort(means);
  const auto percentile = [&](double fraction) { return means[static_cast<std::size_t>(fraction * (samples - 1))]; };
  return {mean, percentile(0.025), percentile(0.975)};
}

Estimate fraction_with_interval(std::uint64_t hits, std::uint64_t n) {
  if (n == 0) return {};
  const double z = 1.959963985, count = static_cast<double>(n), fraction = static_cast<double>(hits) / count;
  const double centre = (fraction + z * z / (2 * count)) / (1 + z * z / count);
  const double half = z / (1 + z * z / count) * std::sqrt(fraction * (1 - fraction) / count + z * z / (4 * count * count));
  return {fraction, std::max(0.0, centre - half), std::min(1.0, centre + half)};
}

bool EvaluationResult::intervals_over_scenes() const {
  std::set<std::string_view> scenes;
  for (const auto& row : episodes) scenes.insert(row.scene);
  return scenes.size() >= kMinScenes;
}

Estimate EvaluationResult::success() const {
  return fraction_over(*this, [](const EpisodeMetrics& m) { return m.success; });
}
Estimate EvaluationResult::spl() const {
  return over(*this, 1, [](const EpisodeMetrics& m) { return m.spl; });
}
Estimate EvaluationResult::soft_spl() const {
  return over(*this, 1, [](const EpisodeMetrics& m) { return m.soft_spl; });
}
Estimate EvaluationResult::sna() const {
  return over(*this, 1, [](const EpisodeMetrics& m) { return m.sna; });
}
Estimate EvaluationResult::success_when_silent() const {
  return fraction_over(*this, [](const EpisodeMetrics& m) { return m.success_when_silent; });
}
Estimate EvaluationResult::dtg_m() const {
  return over(*this, kUnbounded, [](const EpisodeMetrics& m) { return m.dtg_m; });
}
Estimate EvaluationResult::steps() const {
  return over(*this, kUnbounded, [](const EpisodeMetrics& m) { return m.steps; });
}
Estimate EvaluationResult::collisions() const {
  return over(*this, kUnbounded, [](const EpisodeMetrics& m) { return m.collisions; });
}

std::string EvaluationResult::shown_agent() const {
  return baseline.empty() || baseline == agent ? agent : agent + " (baseline " + baseline + ")";
}

std::vector<std::pair<std::string, Estimate>> EvaluationResult::summary() const {
  return {{"success", success()},
          {"spl", spl()},
          {"soft_spl", soft_spl()},
          {"sna", sna()},
          {"success_when_silent", success_when_silent()},
          {"dtg_m", dtg_m()},
          {"steps", steps()},
          {"collisions", collisions()}};
}

void save_result(const EvaluationResult& result, const std::filesystem::path& path) {
  Json rows = Json::array();
  for (const auto& row : result.episodes) {
    const auto& m = row.metrics;
    rows.push_back({{"id", row.id},
                    {"scene", row.scene},
                    {"sound", row.sound},
                    {"novelty", row.novelty},
                    {"success", m.success},
                    {"spl", m.spl},
                    {"soft_spl", m.soft_spl},
                    {"sna", m.sna},
                    {"success_when_silent", m.success_when_silent},
                    {"dtg_m", m.dtg_m},
                    {"reward", m.reward},
                    {"steps", m.steps},
                    {"stopped", m.stopped},
                    {"collisions", m.collisions},
                    {"actions", row.actions}});
  }
  Json summary = {{"episodes", result.episodes.size()}};
  for (const auto& [name, estimate] : result.summary()) summary[name] = to_json(estimate);
  Json json = {{"earshot_result", kResultVersion},
               {"agent", result.agent},
               {"policy_hash", result.policy_hash},
               {"set_hash", result.set_hash},
               {"partial_of", result.partial_of},
               {"engine_hash", result.engine_hash},
               {"episodes_file", result.episodes_file},
               {"seed", result.seed},
               {"baseline", result.baseline},
               {"track", result.track},
               {"senses", result.senses},
               {"rules", result.rules},
               {"toolchain", result.toolchain},
               {"summary", summary},
               {"episodes", rows}};
  json["checksum"] = checksum_of(json);
  write_file_atomically(path, json_text(json, 1) + "\n");
}

namespace {

/// Texts of a result are printed: one that moves the cursor or turns a line around would show what the file does not say.
void refuse_control_characters(const nlohmann::json& json, const std::string& where) {
  const auto check = [&](const std::string& text) {
    if (has_control_character(text))
      throw InputError(where, "has a text with control characters: '" + text + "'", "use a file written by 'earshot eval --out'");
  };
  if (json.is_string()) check(json.get_ref<const std::string&>());
  if (json.is_object())
    for (const auto& [key, value] : json.items()) check(key);
  if (json.is_structured())
    for (const auto& value : json)
      if (!value.is_number()) refuse_control_characters(value, where);
}

/// A whole result of 14,000 episodes of 280 steps fits.
constexpr JsonLimits kResultLimits{.values = 4'000'000, .texts = 700'000, .lists = 100'000};

nlohmann::json parse_result(const std::filesystem::path& path) {
  const std::string text = read_regular_file(path, kMaxResultBytes);
  check_json_depth(text, path.string());
  check_json_size(text, path.string(), kResultLimits);
  nlohmann::json json = parse_json(text);
  refuse_control_characters(json, path.string());
  return json;
}

void read_summary(const nlohmann::json& summary, EvaluationResult& result) {
  for (const auto& [name, value] : summary.items()) {
    if (name == "episodes")
      result.claimed_episodes = whole_number<std::uint64_t>(summary, "episodes");
    else
      result.claimed_summary[name] = {finite_number<double>(value, "mean"), finite_number<double>(value, "low"),
                                      finite_number<double>(value, "high")};
  }
}

}  // namespace

EvaluationResult load_result(const std::filesystem::path& path) {
  EvaluationResult result;
  try {
    auto json = parse_result(path);
    check_schema_version(json, "earshot_result", path.string(), "a result", {1, kResultVersion});
    json.at("agent").get_to(result.agent);
    json.at("policy_hash").get_to(result.policy_hash);
    json.at("set_hash").get_to(result.set_hash);
    json.at("engine_hash").get_to(result.engine_hash);
    json.at("episodes_file").get_to(result.episodes_file);
    result.seed = whole_number<std::uint64_t>(json, "seed");
    if (json.contains("partial_of")) json.at("partial_of").get_to(result.partial_of);
    if (json.contains("rules")) json.at("rules").get_to(result.rules);
    if (json.contains("senses")) json.at("senses").get_to(result.senses);
    if (json.contains("track")) json.at("track").get_to(result.track);
    if (json.contains("baseline")) json.at("baseline").get_to(result.baseline);
    if (!json.contains("baseline") && baseline_by_name(result.policy_hash)) result.baseline = result.policy_hash;
    if (json.contains("toolchain")) json.at("toolchain").get_to(result.toolchain);
    if (json.contains("checksum")) {
      const auto checksum = json.at("checksum").get<std::string>();
      json.erase("checksum");
      result.matches_checksum = checksum == checksum_of(json);
    }
    if (json.contains("summary")) read_summary(json.at("summary"), result);
    for (const auto& row : json.at("episodes")) {
      EvaluationResult::Row read;
      row.at("id").get_to(read.id);
      row.at("scene").get_to(read.scene);
      if (row.contains("sound")) row.at("sound").get_to(read.sound);
      if (row.contains("novelty")) row.at("novelty").get_to(read.novelty);
      if (row.contains("stopped")) row.at("stopped").get_to(read.metrics.stopped);
      read.metrics.success = finite_number<double>(row, "success");
      read.metrics.spl = finite_number<double>(row, "spl");
      read.metrics.soft_spl = finite_number<double>(row, "soft_spl");
      read.metrics.sna = finite_number<double>(row, "sna");
      if (row.contains("success_when_silent"))  // results of before it was counted have none
        read.metrics.success_when_silent = finite_number<double>(row, "success_when_silent");
      read.metrics.dtg_m = finite_number<double>(row, "dtg_m");
      read.metrics.reward = finite_number<double>(row, "reward");
      read.metrics.steps = whole_number<int>(row, "steps");
      read.metrics.collisions = whole_number<int>(row, "collisions");
      for (const auto& action : row.at("actions")) {
        if (!action.is_number_unsigned() || action.get<std::uint64_t>() >= static_cast<std::uint64_t>(kNumActions))
          throw InputError(path.string(), "contains an unknown action", "use a file written by 'earshot eval --out'");
        read.actions.push_back(action.get<std::int8_t>());
      }
      result.episodes.push_back(std::move(read));
    }
  } catch (const nlohmann::json::exception& error) {
    throw InputError(path.string(), error.what(), "use a file written by 'earshot eval --out'");
  }
  return result;
}

std::string set_hash_of_first(const EpisodeSet& set, std::size_t episodes) {
  EARSHOT_EXPECT(episodes <= set.episodes.size());
  if (episodes == set.episodes.size()) return hex64(set.hash);
  return hex64(episode_set_hash({set.episodes.begin(), set.episodes.begin() + static_cast<std::ptrdiff_t>(episodes)}));
}

}  // namespace earshot
