// SPDX-License-Identifier: Apache-2.0
#include "evaluation/leaderboard/benchmark.h"

#include <fmt/format.h>

#include <algorithm>
#include <vector>

#include "envs/episodes/name_ranges.h"
#include "evaluation/leaderboard/board_entry.h"
#include "evaluation/results/result_groups.h"
#include "evaluation/results/set_digest.h"
#include "evaluation/results/split_overlap.h"
#include "sim/base/control_characters.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/regular_file.h"
#include "sim/base/text/config_reader.h"
#include "sim/base/text/listed.h"
#include "trainer/run/effective_config.h"
#include "trainer/run/episode_data.h"

namespace earshot {
namespace {

constexpr About kBenchmarkAbout("Facts that fix the benchmark; the other sections are those of a run config.");
constexpr std::size_t kMaxBytes = std::size_t{1} << 20;

/// The sounds of the test set that must be new: those of heard_sounds are taken out, once they are known to be of both.
std::vector<std::string> new_sounds(const Benchmark& benchmark, const std::vector<std::string>& trained, std::vector<std::string> tested) {
  for (const std::string& heard : expand_sounds(benchmark.heard_sounds)) {
    const bool is_in_both = std::ranges::count(trained, heard) > 0 && std::ranges::count(tested, heard) > 0;
    if (!is_in_both)
      throw InputError(benchmark.name,
                       fmt::format("lists '{}' in benchmark.heard_sounds, but training and test sets do not both contain it", heard),
                       "remove it from this list");
    std::erase(tested, heard);
  }
  return tested;
}

/// Values of the text of a file, whatever the type.
std::string key_values(const std::map<std::string, std::string>& values) {
  std::string text;
  for (const auto& [key, value] : values) text += key + "=" + value + "\n";
  return text;
}

/// Keys of a run config that a machine may have its own in an evaluation.
bool is_free_in_evaluation(const std::string& key) {
  if (key.starts_with("env.")) return is_local_key(key.substr(4));
  return key == "out" || key == "eval_envs" || key == "data.eval.file";
}

/// The run of the file with overrides, none of which may change what is fixed.
RunConfig overridden(const RunConfig& run, const std::vector<std::string>& keys, const std::vector<std::string>& overrides,
                     const std::string& where) {
  if (overrides.empty()) return run;
  std::vector<std::string> all = keys;
  all.insert(all.end(), overrides.begin(), overrides.end());
  RunConfig changed = parse_run_config("", where, all);
  for (const ConfigChange& change : config_changes(flat_config(config_text(run)), flat_config(config_text(changed))))
    if (!is_free_in_evaluation(change.key))
      throw InputError("--set " + change.key, fmt::format("= {}, but {} has {}: it is fixed", change.now, where, change.before),
                       "leave it out; folders, threads and sizes of caches may be set");
  return changed;
}

/// Automatic choices of an evaluation would differ between machines, and the process of a policy opens no files.
void refuse_undecided(const Benchmark& benchmark, const std::string& where) {
  if (!benchmark.run.env.accuracy.empty())
    throw InputError(where, "has env.accuracy, which each machine plans by itself", "write the acoustics that it comes to (earshot plan)");
  refuse_channels_of_file(benchmark.run.env.observation.channels, where);
  if (has_control_character(benchmark.name) || benchmark.name.empty())
    throw InputError(where, "has a benchmark.name that is empty or has control characters", "write letters, digits and signs");
}

}  // namespace

std::string hash_of_senses(const SensedConfig& senses, const std::vector<Track>& tracks) {
  std::string text = key_values(senses);
  for (const Track& track : tracks) text += fmt::format("track {}={}\n", track.name, listed(track.sensors, ","));
  return hex64(hash64(text));
}

std::string hash_of_rules(const MetricRules& rules) { return hex64(hash64(key_values(rules))); }

namespace {

/// Rules and senses are those that the file fixes.
void check_hashes(const Benchmark& benchmark, const std::string& where) {
  const std::string rules = hash_of_rules(metric_rules(benchmark.run.env, benchmark.run.eval_envs));
  if (rules != benchmark.rules_hash)
    throw InputError(where, fmt::format("has rules with hash {}, but benchmark.rules_hash is {}", rules, benchmark.rules_hash),
                     "restore the benchmark file, or give the changed rules another version and this hash");
  const std::string senses = hash_of_senses(sensed_config(benchmark.run.env), benchmark.tracks);
  if (senses != benchmark.senses_hash)
    throw InputError(where,
                     fmt::format("has senses and tracks with hash {}, but benchmark.senses_hash is {}", senses,
                                 benchmark.senses_hash.empty() ? "missing" : benchmark.senses_hash),
                     "restore the benchmark file, or give what agents sense another version and this hash");
}

}  // namespace

void read(ConfigReader& file, Benchmark& benchmark) {
  ConfigReader section = file.child("benchmark", kBenchmarkAbout);
  const Allowed hash = Allowed::text("16 hexadecimal digits"), sha256 = Allowed::text("64 hexadecimal digits");
  section.read_required("name", benchmark.name, Allowed::any(), "Name of the benchmark.");
  section.read_required("version", benchmark.version, Allowed::any(), "Version; another one whenever set or rules change.");
  section.read_required("set_hash", benchmark.set_hash, hash, "Hash of the episodes of data.eval.");
  section.read_required("rules_hash", benchmark.rules_hash, hash, "Hash of the rules that metrics depend on: task and navmesh.");
  section.read("senses_hash", benchmark.senses_hash, hash, "Hash of the sensors, the acoustics and the tracks.");
  section.read("seed", benchmark.seed, "Seed of sampled actions.");
  section.read("content_sha256", benchmark.content_sha256, sha256, "SHA-256 of the files of scenes and sounds. Empty: the set names none.");
  section.read("heard_sounds", benchmark.heard_sounds, Allowed::text("a sound"), "Sounds of the test set that training may have too.");
  section.read("held_out_kinds", benchmark.held_out_kinds, Allowed::text("a kind of sound"),
               "Kinds of sound of the test set that training has none of.");
  ConfigReader hidden = section.child("private", "A second test set that is not published.");
  hidden.read("sha256", benchmark.private_sha256, sha256, "SHA-256 of the file of the private set. Empty: there is none.");
  hidden.finish();
  const bool is_hash =
      benchmark.private_sha256.size() == 64 && benchmark.private_sha256.find_first_not_of("0123456789abcdef") == std::string::npos;
  if (!benchmark.private_sha256.empty() && !is_hash)
    throw InputError(file.where(), "has a benchmark.private.sha256 that is not 64 hexadecimal digits",
                     "write the output of sha256sum, in quotes");
  if (section.is_describing())
    static_cast<void>(read_tracks(section, {}));
  else
    static_cast<void>(section.child("tracks", kTracksAbout));  // read once the sensors are known
  section.finish();
}

Benchmark load_benchmark(const std::filesystem::path& path, const std::vector<std::string>& overrides) {
  const std::string where = path.string();
  Benchmark benchmark;
  ConfigReader file = ConfigReader::from_text(read_regular_file(path, kMaxBytes), where);
  if (file.text().size() > kMaxBytes) throw InputError(where, "is too long for a benchmark file", "use a file of configs/benchmarks");
  if (!file.has("benchmark")) throw InputError(where, "has no section 'benchmark'", "use a file of configs/benchmarks");
  read(file, benchmark);
  std::vector<std::string> run;
  for (const auto& [key, value] : file.flat())
    if (!key.starts_with("benchmark.")) run.push_back(key + "=" + value);
  benchmark.run = parse_run_config("", where, run);
  ConfigReader section = file.child("benchmark", kBenchmarkAbout);
  benchmark.tracks = read_tracks(section, benchmark.run.env.observation);
  refuse_undecided(benchmark, where);
  if (benchmark.run.eval.file.empty()) throw InputError(where, "has no data.eval.file", "set it to the file of the test set");
  check_hashes(benchmark, where);
  benchmark.run = overridden(benchmark.run, run, overrides, where);
  return benchmark;
}

EpisodeSet benchmark_set(const Benchmark& benchmark) {
  const DataConfig& data = benchmark.run.eval;
  EpisodeSet set = std::filesystem::exists(data.file) ? load_episode_set(data.file) : generate_data(data, benchmark.run.env);
  if (hex64(set.hash) != benchmark.set_hash)
    throw InputError(
        data.file,
        fmt::format("contains the set {}, but {} {} needs {}", hex64(set.hash), benchmark.name, benchmark.version, benchmark.set_hash),
        "delete the file so that it is written again; if the hash stays the same, this build generates other episodes");
  const std::string content = digest_of_content(set, benchmark.run.env.scene_root, benchmark.run.env.sound_root);
  if (content != benchmark.content_sha256)
    throw InputError(data.file,
                     fmt::format("names files of scenes and sounds with the SHA-256 {}, but {} {} needs {}",
                                 content.empty() ? "(none)" : content, benchmark.name, benchmark.version,
                                 benchmark.content_sha256.empty() ? "none: benchmark.content_sha256 is missing" : benchmark.content_sha256),
                     "restore the files, or give other ones another version and this hash");
  return set;
}

void check_held_out_kinds(const Benchmark& benchmark, const std::vector<std::string>& trained, const std::vector<std::string>& tested) {
  for (const std::string& kind : benchmark.held_out_kinds) {
    const auto of_kind = [&](const std::string& sound) { return sound_kind(sound) == kind; };
    if (const auto found = std::ranges::find_if(trained, of_kind); found != trained.end())
      throw InputError(benchmark.name,
                       fmt::format("has '{}' in data.train, which belongs to '{}' in benchmark.held_out_kinds", *found, kind),
                       "remove it from one of them");
    if (std::ranges::none_of(tested, of_kind))
      throw InputError(benchmark.name, fmt::format("has no sound of kind '{}' (benchmark.held_out_kinds) in its test set", kind),
                       "remove it from this list");
  }
}

void check_splits(const Benchmark& benchmark) {
  const RunConfig& run = benchmark.run;
  const auto refuse = [&](const SplitOverlap& found) {
    throw InputError(benchmark.name, fmt::format("has '{}' in its test set, {} '{}' of data.train", found.tested, found.why, found.trained),
                     "remove it from one of them");
  };
  const auto scenes = find_scene_overlap(expand_ranges(run.train.scenes), expand_ranges(run.eval.scenes), run.env.scene_root);
  if (scenes) refuse(*scenes);
  const auto trained = expand_sounds(run.train.sounds), tested = expand_sounds(run.eval.sounds);
  check_held_out_kinds(benchmark, trained, tested);
  const auto sounds = find_sound_overlap(trained, new_sounds(benchmark, trained, tested), run.env.sound_root);
  if (sounds) refuse(*sounds);
}

Verification verify_for_benchmark(const EvaluationResult& result, const std::string& where, const Benchmark& benchmark,
                                  const EpisodeSet& set, const VerifyConfig& config) {
  const char* remedy = "evaluate the agent again with --benchmark";
  if (result.seed != benchmark.seed)
    throw InputError(where, fmt::format("was run with seed {}, but {} needs {}", result.seed, benchmark.name, benchmark.seed), remedy);
  Standing standing = standing_of(result, where, benchmark);
  Verification verified =
      verify_result(result, where, set, rules_for(result.rules, metric_rules(benchmark.run.env, benchmark.run.eval_envs)), config);
  verified.standing = std::move(standing);
  EvaluationResult noted = result;
  note_novelty(noted, expand_sounds(benchmark.run.train.sounds));
  for (std::size_t i = 0; i < noted.episodes.size(); ++i)
    if (!result.episodes[i].novelty.empty() && result.episodes[i].novelty != noted.episodes[i].novelty)
      throw InputError(where,
                       fmt::format("lists the sound of episode {} as '{}' relative to training; by the benchmark it is '{}'", i,
                                   result.episodes[i].novelty, noted.episodes[i].novelty),
                       remedy);
  return verified;
}

}  // namespace earshot
