// SPDX-License-Identifier: Apache-2.0
// Results that are not what a benchmark ranks: each kind of cheat is refused with its reason, or shown apart with it.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "evaluation/leaderboard/board_entry.h"
#include "evaluation/leaderboard/leaderboard.h"
#include "evaluation/results/evaluator.h"
#include "sim/base/random.h"
#include "sim/base/text/json.h"
#include "tests/support/programs/benchmark_file.h"

namespace earshot {
namespace {

using testing::HasSubstr;

/// Draws of one instance of a cheat.
class Draws {
 public:
  Draws(std::uint32_t kind, std::uint32_t instance) : random_(11, Purpose::test, kind, instance) {}
  std::size_t below(std::size_t n) { return random_.below(static_cast<std::uint32_t>(n), next_++); }
  double uniform() { return static_cast<double>(random_.uniform(next_++)); }

 private:
  RandomStream random_;
  std::uint32_t next_ = 0;
};

struct Cheat {
  const char* name;
  std::function<void(EvaluationResult&, Draws&)> forge;
  std::string reason;  ///< that the refusal, or the note of what is shown apart, says
};

EvaluationResult::Row& any_row(EvaluationResult& result, Draws& draws) { return result.episodes[draws.below(result.episodes.size())]; }

/// Numbers of a row that its actions do not give.
std::vector<Cheat> cheats_with_metrics() {
  using Change = void (*)(EpisodeMetrics&, double);
  const std::pair<const char*, Change> metrics[] = {
      {"success", [](EpisodeMetrics& m, double by) { m.success += by; }},
      {"spl", [](EpisodeMetrics& m, double by) { m.spl += by; }},
      {"soft_spl", [](EpisodeMetrics& m, double by) { m.soft_spl += by; }},
      {"sna", [](EpisodeMetrics& m, double by) { m.sna += by; }},
      {"success_when_silent", [](EpisodeMetrics& m, double by) { m.success_when_silent += by; }},
      {"dtg_m", [](EpisodeMetrics& m, double by) { m.dtg_m += by; }},
      {"reward", [](EpisodeMetrics& m, double by) { m.reward += by; }},
      {"steps", [](EpisodeMetrics& m, double by) { m.steps += 1 + static_cast<int>(9 * by); }},
      {"stopped", [](EpisodeMetrics& m, double) { m.stopped = !m.stopped; }},
      {"collisions", [](EpisodeMetrics& m, double by) { m.collisions += 1 + static_cast<int>(9 * by); }}};
  std::vector<Cheat> cheats;
  for (const auto& [name, change] : metrics)
    cheats.push_back({name, [change](EvaluationResult& r, Draws& d) { change(any_row(r, d).metrics, 1e-6 + d.uniform()); },
                      std::string("reports ") + name});
  return cheats;
}

std::vector<Cheat> cheats_with_rows() {
  return {
      {"an action left out", [](EvaluationResult& r, Draws& d) { any_row(r, d).actions.pop_back(); }, "episode"},
      {"an action added", [](EvaluationResult& r, Draws& d) { any_row(r, d).actions.push_back(1); }, "actions after its end"},
      {"another action",
       [](EvaluationResult& r, Draws& d) {
         auto& actions = any_row(r, d).actions;
         auto& action = actions[d.below(actions.size() - 1)];  // not the last one
         action = static_cast<std::int8_t>(action == 0 ? 1 : 0);
       },
       "episode"},
      {"an easier episode twice",
       [](EvaluationResult& r, Draws& d) {
         const std::size_t from = d.below(r.episodes.size());
         r.episodes[(from + 1 + d.below(r.episodes.size() - 1)) % r.episodes.size()] = r.episodes[from];
       },
       "episode"},
      {"an episode left out",
       [](EvaluationResult& r, Draws& d) {
         r.episodes.erase(r.episodes.begin() + static_cast<std::ptrdiff_t>(d.below(r.episodes.size())));
       },
       "is partial"},
      {"one too many", [](EvaluationResult& r, Draws& d) { r.episodes.push_back(any_row(r, d)); }, "but its set has"},
      {"two in another order",
       [](EvaluationResult& r, Draws& d) {
         const std::size_t a = d.below(r.episodes.size()), b = (a + 1 + d.below(r.episodes.size() - 1)) % r.episodes.size();
         std::swap(r.episodes[a], r.episodes[b]);
       },
       "is at the place of"},
      {"another sound", [](EvaluationResult& r, Draws& d) { any_row(r, d).sound = fmt::format("synth:bird:{}", 100 + d.below(50)); },
       "lists its sound as"},
      {"another scene", [](EvaluationResult& r, Draws& d) { any_row(r, d).scene = fmt::format("house:{}", 20 + d.below(50)); },
       "is at the place of"},
      {"another name", [](EvaluationResult& r, Draws& d) { any_row(r, d).id += fmt::format("{}", d.below(9)); }, "is at the place of"},
      {"another novelty", [](EvaluationResult& r, Draws& d) { any_row(r, d).novelty = d.below(2) == 0 ? "none" : "quite new"; },
       "relative to training"},
  };
}

std::vector<Cheat> cheats_with_heads() {
  return {
      {"another set", [](EvaluationResult& r, Draws& d) { r.set_hash = hex64(d.below(1u << 30)); }, "belongs to the set"},
      {"part of a set", [](EvaluationResult& r, Draws& d) { r.partial_of = hex64(d.below(1u << 30)); }, "partial"},
      {"another engine", [](EvaluationResult& r, Draws& d) { r.engine_hash = hex64(d.below(1u << 30)); }, "was made by engine"},
      {"another seed", [](EvaluationResult& r, Draws& d) { r.seed = 1 + d.below(1000); }, "was run with seed"},
      {"a larger goal", [](EvaluationResult& r, Draws& d) { r.rules["task.success_radius_m"] = fmt::format("{}", 2 + d.below(9)); },
       "task.success_radius_m"},
      {"more steps", [](EvaluationResult& r, Draws& d) { r.rules["task.max_steps"] = fmt::format("{}", 61 + d.below(900)); },
       "task.max_steps"},
      {"a thinner agent", [](EvaluationResult& r, Draws& d) { r.rules["navmesh.agent_radius_m"] = fmt::format("0.0{}", 1 + d.below(8)); },
       "navmesh.agent_radius_m"},
      {"a name that moves the cursor",
       [](EvaluationResult& r, Draws& d) {
         constexpr const char* kinds[] = {"\x1b[2J",
                                          "\x1b]0;x\x07",
                                          "\xc2\x9b"
                                          "31m",
                                          "\xe2\x80\xae",
                                          "a\nb",
                                          "\r",
                                          "\xe2\x81\xa6"};
         r.agent += kinds[d.below(7)];
       },
       "control characters"},
      {"an older file", [](EvaluationResult& r, Draws&) { r.senses.clear(); }, "does not say what it sensed"},
      {"a track by name", [](EvaluationResult& r, Draws& d) { r.track = d.below(2) == 0 ? "ears" : "best"; }, "asks for the track"},
      {"the oracle under another name",
       [](EvaluationResult& r, Draws& d) {
         r.agent = fmt::format("DeepEar-{}", d.below(99));
         r.baseline = d.below(2) == 0 ? "oracle" : "random_oracle_stop";
       },
       "reads the goal and the map of the simulator"},
      {"a baseline that there is not", [](EvaluationResult& r, Draws& d) { r.baseline = fmt::format("expert{}", d.below(99)); },
       "names a baseline"},
  };
}

/// One key of what the agent sensed by, with drawn values.
Cheat sense(const char* key, std::vector<std::string> values, std::string reason = {}) {
  return {key, [key, values](EvaluationResult& r, Draws& d) { r.senses[key] = values[d.below(values.size())]; },
          reason.empty() ? std::string("env.") + key : std::move(reason)};
}

std::vector<Cheat> cheats_with_senses() {
  std::vector<Cheat> cheats{
      sense("sound_gain", {"0.01", "0.5", "100", "12.6"}),
      sense("acoustics.rays", {"1", "7", "65536"}),
      sense("acoustics.late", {"off"}),
      sense("acoustics.early_order", {"0", "1", "9"}),
      sense("acoustics.rir_length_s", {"0.1", "3"}),
      sense("acoustics.seed", {"3", "77"}),
      sense("acoustics.sample_rate_hz", {"8000", "48000"}),
      sense("hrtf", {"head.sofa", "\"\x41\x42\""}),
      sense("crossfade_s", {"0", "0.01"}),
      sense("sound_restarts", {"true"}),
      sense("stage_limit_s", {"1", "0.2"}),
      sense("agents", {"2", "3"}),
      sense("seed", {"5", "99"}),
      sense("task.step_time_s", {"0.3", "0.075"}),
      sense("task.actuation_noise.forward_m", {"0.01", "0.03"}),
      sense("navmesh.max_climb_m", {"0.5", "1"}),
      sense("accuracy", {"t20=10%"}),
      sense("no.such.key", {"1"}),
      sense("observation.pointgoal", {"true"}, "reads 'pointgoal', which is privileged: it is derived from the goal"),
      sense("observation.topdown_map", {"true"}, "reads 'topdown_map', which is privileged: it is derived from the map"),
      sense("observation.goal_state", {"true"}, "reads 'goal_state', which is privileged: it is derived from the goal"),
      sense("observation.oracle_action", {"true"}, "reads 'oracle_action', which is privileged: it is derived from the goal"),
      sense("observation.semantic", {"true"}, "reads 'semantic', which is not a sensor of any track"),
      sense("observation.normals", {"true"}, "reads 'normals', which is not a sensor of any track"),
      sense("observation.spectrogram", {"false"}, "reads no sensor of the ears"),
      sense("observation.camera.width_px", {"32", "256"}),
      sense("observation.camera.horizontal_fov_deg", {"60", "120"}),
      sense("observation.camera.max_depth_m", {"20", "100"}),
      sense("observation.depth_noise", {"true"}),
      sense("observation.legacy_spectrogram", {"true"}),
      sense("observation.renderer", {"egl", "auto"}),
  };
  cheats.push_back({"a map with the goal",
                    [](EvaluationResult& r, Draws&) { r.senses["observation.topdown_map"] = r.senses["observation.map.goal"] = "true"; },
                    "reads 'topdown_map', which is privileged"});
  cheats.push_back({"another camera",
                    [](EvaluationResult& r, Draws& d) {
                      r.senses.erase("observation.cameras");
                      r.senses["observation.cameras.back.depth"] = "true";
                      r.senses["observation.cameras.back.yaw_deg"] = fmt::format("{}", d.below(360));
                    },
                    "reads 'back_depth', which is not a sensor of any track"});
  cheats.push_back({"a key left out",
                    [](EvaluationResult& r, Draws& d) {
                      const char* keys[] = {"sound_gain", "acoustics.rays", "crossfade_s", "seed"};
                      r.senses.erase(keys[d.below(4)]);
                    },
                    "(absent)"});
  cheats.push_back({"a better position than the benchmark's",
                    [](EvaluationResult& r, Draws& d) {
                      r.senses["observation.pose"] = "true";
                      r.senses["observation.noise.position_m"] = d.below(2) == 0 ? "0" : "0.01";
                    },
                    "env.observation.noise.position_m"});
  return cheats;
}

std::vector<Cheat> all_cheats() {
  std::vector<Cheat> all;
  for (const auto& cheats : {cheats_with_metrics(), cheats_with_rows(), cheats_with_heads(), cheats_with_senses()})
    all.insert(all.end(), cheats.begin(), cheats.end());
  return all;
}

/// A board of two houses; a result that says it is of a policy with ears and eyes.
class Forgeries : public BenchmarkFile {
 protected:
  Forgeries() {
    config_.env.observation.camera.width_px = config_.env.observation.camera.height_px = 64;
    config_.env.observation.gps_compass = true;
    config_.env.observation.pose_noise.position_m = 0.2f;
    config_.env.sound_gain = 12;
    rules_hash_ = hash_of_rules(metric_rules(config_.env, config_.eval_envs));
    make_public_set();
  }
  EvaluationResult evaluated(Baseline baseline, const std::string& name) const {
    EnvConfig env = config_.env;
    env.observation.depth = env.observation.spectrogram = false;  // walked without looking: the oracle needs neither
    EvaluationConfig evaluation;
    evaluation.episodes = path("public.json");
    evaluation.num_envs = config_.eval_envs;
    evaluation.threads = 1;
    EvaluationResult result = evaluate_baseline(baseline, name, env, evaluation);
    result.rules = metric_rules(config_.env, config_.eval_envs);
    result.senses = sensed_config(config_.env);
    return result;
  }
  /// Whoever writes a false file has the program, and the checksum with it.
  std::string judged(const EvaluationResult& forged, const Benchmark& benchmark, const EpisodeSet& set) const {
    std::string apart;
    const std::string refused = refusal([&] {
      save_result(forged, path("forged.json"));
      apart = verify_for_benchmark(load_result(path("forged.json")), "forged.json", benchmark, set, {.threads = 1}).standing.apart;
    });
    return refused.empty() ? apart : refused;
  }
};

TEST_F(Forgeries, OfEveryKindAreRefusedWithTheReason) {
  const Benchmark benchmark = load();
  const EpisodeSet set = benchmark_set(benchmark);
  EvaluationResult honest = evaluated(Baseline::oracle, "agent");
  honest.baseline.clear();
  EXPECT_EQ(judged(honest, benchmark, set), "");
  const std::vector<Cheat> cheats = all_cheats();
  EXPECT_GE(cheats.size(), 60u);
  constexpr std::uint32_t kInstances = 4;
  for (std::uint32_t kind = 0; kind < cheats.size(); ++kind)
    for (std::uint32_t instance = 0; instance < kInstances; ++instance) {
      Draws draws(kind, instance);
      EvaluationResult forged = honest;
      cheats[kind].forge(forged, draws);
      EXPECT_THAT(judged(forged, benchmark, set), HasSubstr(cheats[kind].reason)) << cheats[kind].name << ", instance " << instance;
    }
}

// What was changed after it was written, without the checksum.
TEST_F(Forgeries, ChangedFilesAreTold) {
  const Benchmark benchmark = load();
  const EpisodeSet set = benchmark_set(benchmark);
  save_result(evaluated(Baseline::oracle, "agent"), path("result.json"));
  auto json = parse_json(read_file(path("result.json")));
  json["senses"]["sound_gain"] = "11";
  write_text(path("result.json"), json_text(json));
  EXPECT_FALSE(load_result(path("result.json")).matches_checksum);
}

TEST_F(Forgeries, HonestResultsStandInTheirTracks) {
  const Benchmark benchmark = load();
  const EpisodeSet set = benchmark_set(benchmark);
  EvaluationResult policy = evaluated(Baseline::oracle, "agent");
  policy.baseline.clear();
  const auto track_with = [&](std::vector<std::pair<std::string, std::string>> keys) {
    EvaluationResult result = policy;
    for (const auto& [key, value] : keys) result.senses["observation." + key] = value;
    const Standing standing = standing_of(result, "result.json", benchmark);
    EXPECT_EQ(standing.apart, "");
    return standing.track;
  };
  EXPECT_EQ(track_with({{"gps_compass", "false"}, {"depth", "false"}}), "ears");
  EXPECT_EQ(track_with({{"gps_compass", "false"}}), "ears and eyes");
  EXPECT_EQ(track_with({{"gps_compass", "false"}, {"rgb", "true"}, {"interaural", "true"}, {"collision", "true"}}), "ears and eyes");
  EXPECT_EQ(track_with({}), "with odometry");
  // Settings of sensors that it does not read are its own.
  EXPECT_EQ(track_with({{"gps_compass", "false"}, {"depth", "false"}, {"camera.width_px", "504"}, {"map.size_px", "32"}}), "ears");
  for (const auto& [baseline, track] : {std::pair("greedy", "ears and eyes"), std::pair("classical", "ears and eyes"),
                                        std::pair("oracle", kAnything), std::pair("random", kAnything)}) {
    EvaluationResult result = policy;
    result.baseline = baseline;
    EXPECT_EQ(standing_of(result, "result.json", benchmark).track, track) << baseline;
  }
  // Whoever asks to be shown apart is, whatever is read.
  EvaluationResult all = policy;
  all.senses["observation.pointgoal"] = "true";
  all.track = kAnything;
  const Standing apart = standing_of(all, "result.json", benchmark);
  EXPECT_EQ(apart.track, kAnything);
  EXPECT_THAT(apart.apart, HasSubstr("reads 'pointgoal'"));
}

// Actions alone have no rank, be they better than all that was run, and neither has what reads the goal.
TEST_F(Forgeries, RanksAreOfPoliciesThatWereRun) {
  EvaluationResult best = evaluated(Baseline::oracle, "sent");
  best.baseline.clear();
  EvaluationResult run = evaluated(Baseline::random, "run"), second = run, cheat = evaluated(Baseline::oracle, "DeepEar-XL");
  second.agent = "second";
  best.standing = {.track = "ears", .rests_on = {}, .apart = {}};
  run.standing = best.standing;
  second.standing = {.track = "ears and eyes", .rests_on = {}, .apart = {}};
  cheat.standing = {.track = kAnything, .rests_on = {}, .apart = "it reads the goal and the map of the simulator"};
  note_evidence(*best.standing, Evidence::actions);
  note_evidence(*run.standing, Evidence::run_by_board);
  note_evidence(*second.standing, Evidence::private_set);
  note_evidence(*cheat.standing, Evidence::run_by_board);
  const auto rows = ranked({best, cheat, second, run});
  EXPECT_EQ(ranks_of(rows), (std::vector<int>{1, 1, 0, 0}));
  const auto json = parse_json(leaderboard_json({best, cheat, second, run}));
  for (const auto& row : json["agents"]) {
    const std::string agent = row["agent"];
    EXPECT_EQ(row["rank"].is_null(), agent == "sent" || agent == "DeepEar-XL") << agent;
    EXPECT_FALSE(row["track"].get<std::string>().empty() || row["rests_on"].get<std::string>().empty()) << agent;
  }
  const std::string text = leaderboard_text({best, cheat, second, run});
  EXPECT_THAT(text, HasSubstr("DeepEar-XL (baseline oracle)"));
  EXPECT_THAT(text, HasSubstr("note: sent is not ranked: its policy was not run by the board"));
  EXPECT_THAT(text, HasSubstr("run by the board, on the private set too"));
}

TEST_F(Forgeries, PoliciesEnterWithTheSensesOfTheBenchmark) {
  const Benchmark benchmark = load();
  EnvConfig policy = benchmark.run.env;
  policy.sound_gain = 1;
  policy.acoustics.rays = 3;
  policy.field_store = "/no/such/folder";
  policy.quarantine_dir = "/no/such/other";
  policy.observation.gps_compass = false;
  policy.observation.pose_noise = {};
  policy.observation.interaural = true;
  const EnvConfig entered = env_for_policy(benchmark, benchmark.run.env, policy, "p.policy", false);
  EXPECT_TRUE(entered.observation.interaural);
  EXPECT_FALSE(entered.observation.gps_compass);
  EXPECT_EQ(entered.sound_gain, 12);
  EXPECT_EQ(entered.acoustics.rays, benchmark.run.env.acoustics.rays);
  EXPECT_EQ(entered.field_store + entered.quarantine_dir, "");
  EXPECT_THAT(changed_in_training(benchmark.run.env, policy), testing::ElementsAre("acoustics.rays", "sound_gain"));
  const auto refused = [&](const EnvConfig& env) {
    return refusal([&] { static_cast<void>(env_for_policy(benchmark, benchmark.run.env, env, "p.policy", false)); });
  };
  EnvConfig cheat = policy;
  cheat.observation.pointgoal = cheat.observation.topdown_map = cheat.observation.map.goal = true;
  cheat.observation.spectrogram = cheat.observation.interaural = false;
  EXPECT_THAT(refused(cheat), HasSubstr("reads 'pointgoal', which is privileged: it is derived from the goal"));
  EXPECT_EQ(refusal([&] { static_cast<void>(env_for_policy(benchmark, benchmark.run.env, cheat, "p.policy", true)); }), "");
  cheat = policy;
  cheat.observation.spectrogram = cheat.observation.interaural = false;
  EXPECT_THAT(refused(cheat), HasSubstr("reads no sensor of the ears"));
  cheat = policy;
  cheat.observation.camera.width_px = 32;
  EXPECT_THAT(refused(cheat), HasSubstr("env.observation.camera.width_px = 32, but tiny 1 has 64"));
  cheat = policy;
  cheat.acoustics.sample_rate_hz = 8000;
  EXPECT_THAT(refused(cheat), HasSubstr("env.acoustics.sample_rate_hz = 8000"));
}

// The benchmark's head is of two ears alone, and ambisonic channels need the late sound in harmonics of their order.
TEST_F(Forgeries, OutsideTheTracksTheWorldFollowsTheChannels) {
  Benchmark benchmark = load();
  benchmark.run.env.hrtf = path("head.sofa");
  write_text(path("head.sofa"), "responses");
  EvaluationResult result = evaluated(Baseline::oracle, "agent");
  result.baseline.clear();
  result.track = kAnything;
  for (const auto& [channels, order] :
       {std::pair("ambisonic:0", 0), {"ambisonic:3", 3}, {"ambisonics:7", 5}, {"quad", 0}, {"binaural", 0}}) {
    EnvConfig policy = config_.env;
    policy.observation.channels = channels;
    const EnvConfig entered = env_for_policy(benchmark, benchmark.run.env, policy, "p.policy", true);
    EXPECT_EQ(entered.acoustics.sh_order, std::max(order, benchmark.run.env.acoustics.sh_order)) << channels;
    EXPECT_EQ(entered.hrtf.empty(), channels != std::string("binaural")) << channels;
    result.senses = sensed_config(entered);
    EXPECT_EQ(standing_of(result, "result.json", benchmark).track, kAnything) << channels;
    result.senses["acoustics.sh_order"] = "4";
    EXPECT_THAT(refusal([&] { static_cast<void>(standing_of(result, "result.json", benchmark)); }),
                HasSubstr("env.acoustics.sh_order = 4"));
    result.senses = sensed_config(entered);
    if (entered.hrtf.empty())
      result.senses["hrtf"] = sensed_config(benchmark.run.env).at("hrtf");
    else
      result.senses.erase("hrtf");
    EXPECT_THAT(refusal([&] { static_cast<void>(standing_of(result, "result.json", benchmark)); }), HasSubstr("env.hrtf")) << channels;
  }
}

TEST_F(Forgeries, TracksAndSensesAreFixedByAHash) {
  EXPECT_EQ(refusal([&] { static_cast<void>(load()); }), "");
  senses_hash_ = "0123456789abcdef";
  EXPECT_THAT(refusal([&] { static_cast<void>(load()); }), HasSubstr("benchmark.senses_hash is 0123456789abcdef"));
  senses_hash_ = "";
  const std::string usual = section_;
  section_ = usual + "  tracks: {deaf: [depth]}\n";
  EXPECT_THAT(refusal([&] { static_cast<void>(load()); }), HasSubstr("has no sensor of the ears"));
  section_ = usual + "  tracks: {all: [heard, pointgoal]}\n";
  EXPECT_THAT(refusal([&] { static_cast<void>(load()); }), HasSubstr("'pointgoal' is privileged"));
  section_ = usual + "  tracks: {all: [heard, smell]}\n";
  EXPECT_THAT(refusal([&] { static_cast<void>(load()); }), HasSubstr("'smell' is not a sensor"));
  section_ = usual + "  tracks: {anything: [heard]}\n";
  EXPECT_THAT(refusal([&] { static_cast<void>(load()); }), HasSubstr("cannot be the name of a track"));
  section_ = usual + "  tracks: {ears: [heard]}\n";
  EXPECT_THAT(refusal([&] { static_cast<void>(load()); }), HasSubstr("senses and tracks with hash"));  // other tracks, another hash
}

TEST_F(Forgeries, OverridesMayNotChangeWhatIsFixed) {
  static_cast<void>(load());
  const auto refused = [&](const std::string& text) {
    return refusal([&] { static_cast<void>(load_benchmark(path("tiny.yaml"), {text})); });
  };
  for (const char* text : {"env.threads=2", "env.field_store=fields", "env.scene_cache_gb=1", "env.prefetch=false", "eval_envs=3"})
    EXPECT_EQ(refused(text), "") << text;
  for (const char* text : {"env.sound_gain=0.01", "env.task.max_steps=900", "env.observation.pointgoal=true", "env.acoustics.rays=1",
                           "env.seed=9", "data.eval.seed=3", "data.train.seed=3"})
    EXPECT_THAT(refused(text), HasSubstr("it is fixed")) << text;
  EXPECT_THAT(refused("nonsense.key=3"), HasSubstr("nonsense"));
}

}  // namespace
}  // namespace earshot
