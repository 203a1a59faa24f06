// SPDX-License-Identifier: Apache-2.0
// Results whose numbers are not what their actions give are refused, whatever was changed in them.
#include "evaluation/results/verify_result.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>

#include "envs/baselines/baselines.h"
#include "evaluation/results/evaluator.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"
#include "tests/support/envs/env_cases.h"

namespace earshot {
namespace {

using Json = nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

/// The reason for which this throws; empty where it does not.
std::string refusal(const std::function<void()>& body) {
  try {
    body();
  } catch (const InputError& error) {
    return error.what();
  }
  return {};
}

/// What save_result writes as the checksum: whoever forges a result has the source too.
Json with_checksum(Json json) {
  json.erase("checksum");
  json["checksum"] = hex64(hash64(json_text(json)));
  return json;
}

class VerifyResult : public testing::Test {
 protected:
  static constexpr int kPerScene = 4, kEnvs = 3;

  static void SetUpTestSuite() {
    folder_ = new TestFolder("verify_result");
    EnvConfig env = quick_env_config();
    env.task.max_steps = 80;
    env.observation.depth = env.observation.spectrogram = false;
    env.task.actuation_noise = {.forward_m = 0.02f, .turn_deg = 1, .veer_deg = 1};
    const auto set = quick_set(kPerScene);
    save_episode_set(*set, path("set.json"));
    for (const auto& [baseline, name] : {std::pair(Baseline::oracle, "oracle"), std::pair(Baseline::random_oracle_stop, "random")})
      save_result(evaluate_baseline(baseline, name, env, evaluation()), path(std::string(name) + ".json"));
  }
  static void TearDownTestSuite() {
    delete folder_;
    folder_ = nullptr;
  }

  static std::filesystem::path path(const std::string& name) { return folder_->path() / name; }
  static EvaluationConfig evaluation() {
    EvaluationConfig config;
    config.episodes = path("set.json").string();
    config.num_envs = kEnvs;
    config.threads = 1;
    config.seed = 5;
    return config;
  }
  static Json json_of(const std::string& name) { return parse_json(read_file(path(name))); }
  static Verification verify(const EvaluationResult& result, const VerifyConfig& config = {}) {
    return verify_result(result, "result", load_episode_set(path("set.json")), result.rules, config);
  }
  /// The reason for which a file of this content is refused, at its reading or by what it holds.  rules: of the honest result.
  static std::string refusal_of(const Json& forged, const VerifyConfig& config = {}) {
    write_file_atomically(path("forged.json"), json_text(forged));
    return refusal([&] {
      const MetricRules rules = load_result(path("oracle.json")).rules;
      verify_result(load_result(path("forged.json")), "forged", load_episode_set(path("set.json")), rules, config);
    });
  }

  static TestFolder* folder_;
};
TestFolder* VerifyResult::folder_ = nullptr;

TEST_F(VerifyResult, WalksWhatTheEnvironmentsRan) {
  for (const char* name : {"oracle.json", "random.json"})
    for (const int threads : {1, 2, 3}) {
      const EvaluationResult result = load_result(path(name));
      EXPECT_TRUE(result.matches_checksum);
      Verification verified;
      ASSERT_EQ(refusal([&] { verified = verify(result, {.threads = threads}); }), "") << name;
      EXPECT_EQ(verified.episodes, 3u * kPerScene);
      EXPECT_TRUE(verified.same_engine);
      EXPECT_FALSE(verified.partial);
    }
  // Both kinds of ends are among them, and walks that meet walls.
  const EvaluationResult oracle = load_result(path("oracle.json")), random = load_result(path("random.json"));
  EXPECT_GT(oracle.success().mean, 0.5);
  EXPECT_LT(random.success().mean, 1);
  EXPECT_GT(random.collisions().mean, 0);
}

TEST_F(VerifyResult, SilenceOfClipsIsFound) {
  std::vector<Episode> episodes{room_episode("shoebox:6x3x5@0.3", {1, 0, 1}, 0, {4, 0, 3}, "synth:noise"),
                                room_episode("shoebox:6x3x5@0.3", {1, 0, 1}, 0, {4, 0, 3}, "synth:noise")};
  for (std::size_t i = 0; i < episodes.size(); ++i) {
    episodes[i].episode_id = std::to_string(i);
    episodes[i].sources = {{.position = episodes[i].goal_position, .sound = "synth:noise", .duration_s = i == 0 ? 0.5 : 1e4, .goal = true}};
  }
  EnvConfig env = quick_env_config();
  env.task.max_steps = 80;
  save_episode_set(*make_set(episodes), path("silent.json"));
  EvaluationConfig config = evaluation();
  config.episodes = path("silent.json").string();
  const EvaluationResult result = evaluate_baseline(Baseline::oracle, "oracle", env, config);
  ASSERT_EQ(result.episodes[0].metrics.success_when_silent, 1);
  ASSERT_EQ(result.episodes[1].metrics.success_when_silent, 0);
  save_result(result, path("silent_result.json"));
  EXPECT_EQ(refusal([&] {
              verify_result(load_result(path("silent_result.json")), "result", load_episode_set(path("silent.json")), result.rules, {});
            }),
            "");
}

TEST_F(VerifyResult, PartialResultsSaySo) {
  EvaluationConfig config = evaluation();
  config.max_episodes = 5;
  EnvConfig env = quick_env_config();
  env.observation.depth = env.observation.spectrogram = false;
  save_result(evaluate_baseline(Baseline::oracle, "oracle", env, config), path("partial.json"));
  const EvaluationResult result = load_result(path("partial.json"));
  const EpisodeSet set = load_episode_set(path("set.json"));
  EXPECT_EQ(result.partial_of, hex64(set.hash));
  EXPECT_NE(result.set_hash, result.partial_of);
  EXPECT_THAT(refusal([&] { verify(result); }), HasSubstr("is partial: it covers 5 of the 12 episodes"));
  EXPECT_EQ(refusal([&] { EXPECT_TRUE(verify(result, {.partial = true}).partial); }), "");
}

// A hundred forgeries of one honest result, each with a checksum that fits.
TEST_F(VerifyResult, RefusesAHundredForgeries) {
  const Json honest = json_of("oracle.json");
  ASSERT_EQ(refusal_of(with_checksum(honest)), "");
  int refused = 0, forged = 0;
  const auto expect_refused = [&](const Json& json, const std::string& reason) {
    ++forged;
    const std::string why = refusal_of(with_checksum(json));
    EXPECT_THAT(why, HasSubstr(reason));
    EXPECT_EQ(why.find('\n'), std::string::npos);
    if (why.find(reason) != std::string::npos) ++refused;
  };
  const std::size_t count = honest["episodes"].size();
  ASSERT_EQ(count, 12u);
  for (std::size_t i = 0; i < count; ++i) {
    const std::string which = "episode " + std::to_string(i) + " (";
    Json json = honest;
    const auto row = [&]() -> Json& { return json["episodes"][i]; };
    // A number, by one unit in the last place or as much as can be claimed.
    const char* number = std::array{"spl", "soft_spl", "dtg_m", "reward"}[i % 4];
    row()[number] = std::nextafter(row()[number].get<double>(), 10.0);
    expect_refused(json, which);
    json = honest;
    const char* whole = std::array{"steps", "collisions"}[i % 2];
    row()[whole] = row()[whole].get<int>() + 1;
    expect_refused(json, std::string("reports ") + whole);
    json = honest;
    row()["sna"] = 9.9;
    expect_refused(json, which);
    json = honest;
    row()["actions"][i] = (row()["actions"][i].get<int>() % 3) + 1;  // another way to go, never stop
    expect_refused(json, which);
    json = honest;
    row()["actions"].push_back(1);
    expect_refused(json, "has 1 actions after its end");
    json = honest;
    row()["scene"] = "house:" + std::to_string(i);
    expect_refused(json, "is at the place of");
    json = honest;
    row()["sound"] = "synth:bird:" + std::to_string(i);
    expect_refused(json, "lists its sound as");
    json = honest;
    std::swap(json["episodes"][i], json["episodes"][(i + 1) % count]);
    expect_refused(json, "is at the place of");
  }
  ASSERT_EQ(forged, 96);
  Json json = honest;
  json["episodes"].erase(11);
  expect_refused(json, "is partial: it covers 11 of the 12");
  json = honest;
  json["engine_hash"] = "0123456789abcdef";
  expect_refused(json, "was made by engine");
  json = honest;
  json["summary"]["spl"]["mean"] = 0.999;
  expect_refused(json, "summary whose 'spl' does not match");
  json = honest;
  json["rules"]["seed"] = "43";
  expect_refused(json, "was run with seed = 43");
  EXPECT_EQ(forged, 100);
  EXPECT_EQ(refused, 100);
}

TEST_F(VerifyResult, RefusesWhatElseCanBeForged) {
  const Json honest = json_of("oracle.json");
  Json json = honest;
  json["seed"] = 6;  // no number follows from it: what was written tells
  EXPECT_THAT(refusal_of(json), HasSubstr("was changed after it was written"));
  json = honest;
  json["set_hash"] = "0123456789abcdef";
  EXPECT_THAT(refusal_of(with_checksum(json)), HasSubstr("belongs to the set 0123456789abcdef"));
  json = honest;
  json["episodes"][3] = json["episodes"][2];
  EXPECT_THAT(refusal_of(with_checksum(json)), HasSubstr("occurs twice"));
  json = honest;
  json["episodes"].push_back(json["episodes"][2]);
  EXPECT_THAT(refusal_of(with_checksum(json)), HasSubstr("has 13 episodes, but its set has 12"));
  json = honest;
  json["rules"]["task.success_radius_m"] = "3";
  EXPECT_THAT(refusal_of(with_checksum(json)), HasSubstr("was run with task.success_radius_m = 3"));
  json = honest;
  json["episodes"][0]["actions"] = Json::array();
  EXPECT_THAT(refusal_of(with_checksum(json)), HasSubstr("ends without a stop after 0 of"));
  json = honest;
  json["partial_of"] = "0123456789abcdef";
  EXPECT_THAT(refusal_of(with_checksum(json)), HasSubstr("is marked as partial"));
  json = honest;
  json["engine_hash"] = "0123456789abcdef";
  EXPECT_EQ(refusal_of(with_checksum(json), {.any_engine = true}), "");
}

TEST_F(VerifyResult, NumbersOfAnotherToolchainAreRefusedAsSuchAndNotAsForged) {
  const Json honest = json_of("oracle.json");
  for (const char* part : {"compiler", "c_library", "processor", "embree"})  // a policy's: ShippedPolicy
    EXPECT_FALSE(honest["toolchain"].value(part, "").empty()) << part;
  const std::string this_toolchain = walking_toolchain(simulation_toolchain());
  EXPECT_EQ(walking_toolchain(load_result(path("oracle.json")).toolchain), this_toolchain);

  // Of another build, with a number that is off by one unit in the last place.
  Json off = honest;
  off["engine_hash"] = "0123456789abcdef";
  off["episodes"][2]["spl"] = std::nextafter(off["episodes"][2]["spl"].get<double>(), 10.0);
  const VerifyConfig any_engine{.any_engine = true};
  EXPECT_THAT(refusal_of(with_checksum(off), any_engine),
              AllOf(HasSubstr("episode 2 ("), HasSubstr("reports spl = "), HasSubstr("are accepted"), Not(HasSubstr("toolchain"))));
  for (const auto& [part, value] : {std::pair("compiler", "g++99"), std::pair("c_library", "glibc 9.9"), std::pair("processor", "armv8-a"),
                                    std::pair("embree", "9.9.9 neon")}) {
    Json json = off;
    json["toolchain"][part] = value;
    const std::string why = refusal_of(with_checksum(json), any_engine);
    EXPECT_THAT(why, AllOf(HasSubstr("episode 2 ("), HasSubstr("reports spl = "), HasSubstr("it was made with "), HasSubstr(value),
                           HasSubstr("verified with " + this_toolchain), HasSubstr("does not prove a forgery")));
    EXPECT_EQ(why.find('\n'), std::string::npos);
    // If this program wrote the file, another toolchain does not excuse a difference.
    json["engine_hash"] = honest["engine_hash"];
    EXPECT_THAT(refusal_of(with_checksum(json)), AllOf(HasSubstr("are accepted"), Not(HasSubstr("does not prove"))));
  }
  // libtorch chose the actions, which the file has: it has no part in the numbers.
  Json json = off;
  json["toolchain"]["libtorch"] = "9.9 AVX9";
  json["toolchain"]["blas"] = "unknown";
  EXPECT_THAT(refusal_of(with_checksum(json), any_engine), Not(HasSubstr("does not prove")));

  // The same numbers are taken, whatever toolchain made them, and older files name none.
  json = honest;
  json["engine_hash"] = "0123456789abcdef";
  json["toolchain"]["compiler"] = "g++99";
  EXPECT_EQ(refusal_of(with_checksum(json), any_engine), "");
  write_file_atomically(path("other.json"), json_text(with_checksum(json)));
  EXPECT_THAT(verify(load_result(path("other.json")), any_engine).toolchain, StartsWith("g++99, "));
  json.erase("toolchain");
  EXPECT_EQ(refusal_of(with_checksum(json), any_engine), "");
  off.erase("toolchain");
  EXPECT_THAT(refusal_of(with_checksum(off), any_engine), AllOf(HasSubstr("an unknown toolchain"), HasSubstr("does not prove")));
}

TEST_F(VerifyResult, RulesThatAreMissingOrUnknownAreRefused) {
  const EvaluationResult result = load_result(path("oracle.json"));
  MetricRules rules = result.rules;
  rules.erase("task.max_steps");
  EXPECT_THAT(refusal([&] { env_of_rules(rules, "result"); }), HasSubstr("task.max_steps"));
  rules = result.rules;
  rules["task.easy"] = "true";
  EXPECT_THAT(refusal([&] { env_of_rules(rules, "result"); }), HasSubstr("easy"));
  rules = result.rules;
  rules["scene_root"] = "/";
  EXPECT_THAT(refusal([&] { env_of_rules(rules, "result"); }), HasSubstr("scene_root"));
  // Rewards are the agent's own affair, errors of actuation are not.
  MetricRules result_rules = result.rules;
  result_rules["task.step_reward"] = "0.5";
  result_rules["seed"] = "7";
  const MetricRules merged = rules_for(result_rules, result.rules);
  EXPECT_EQ(merged.at("task.step_reward"), "0.5");
  EXPECT_EQ(merged.at("seed"), result.rules.at("seed"));
}

}  // namespace
}  // namespace earshot
