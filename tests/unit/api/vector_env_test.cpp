// SPDX-License-Identifier: Apache-2.0
// The public batch of environments and sets of episodes against the engine's: the same bits, and the same refusals.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "earshot/env.h"
#include "earshot/episodes.h"
#include "envs/batch/batched_env.h"
#include "envs/config/batch_config.h"
#include "sim/base/random.h"
#include "tests/support/files/test_files.h"
#include "tests/support/wait_until.h"

namespace earshot {
namespace {

using testing::HasSubstr;

const std::string kEnvKeys = "{acoustics: {rays: 4, early_order: 1, rir_length_s: 0.1, field: off}, task: {max_steps: 9}}";
const std::string kDrawnEpisodes =
    "{scenes: ['shoebox:5x3x4@0.2', 'shoebox:6x3x5@0.3'], episodes_per_scene: 3, sounds: ['synth:telephone'], "
    "filter: {min_geodesic_m: 1, min_ratio: 1}}";
const std::string kBatchYaml =
    "seed: 9\nacoustics: {rays: 4, early_order: 1, rir_length_s: 0.1, field: off}\ntask: {max_steps: 9}\nepisodes: " + kDrawnEpisodes +
    "\n";
const std::string kRunYaml = "seed: 9\nenv: " + kEnvKeys + "\ndata: {eval: " + kDrawnEpisodes + "}\n";

api::EpisodeOptions drawn_options() {
  return {.scenes = {"shoebox:5x3x4@0.2", "shoebox:6x3x5@0.3"},
          .sounds = {"synth:telephone"},
          .episodes_per_scene = 3,
          .settings = {{"filter.min_geodesic_m", 1}, {"filter.min_ratio", 1}},
          .task = {{"max_steps", 9}}};
}

/// Actions of one step: any but stop.
std::vector<std::int32_t> actions_of(int step, int rows) {
  const RandomStream random(3, Purpose::episode, static_cast<std::uint32_t>(step));
  std::vector<std::int32_t> actions(static_cast<std::size_t>(rows));
  for (std::size_t row = 0; row < actions.size(); ++row)
    actions[row] = 1 + static_cast<std::int32_t>(random.below(3, static_cast<std::uint32_t>(row)));
  return actions;
}

bool same_bytes(std::span<const std::byte> a, std::span<const std::byte> b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size()) == 0;
}

TEST(ApiVectorEnv, StepsHaveTheBitsOfTheEngineFromEveryFormOfConfig) {
  const BatchParts parts = read_batch(kBatchYaml, "text", {}, {}, "train");
  BatchedEnv expected(parts.config, parts.set, parts.scenes, 3);
  std::vector<api::VectorEnv> batches;
  batches.emplace_back(api::Config::from_text(kBatchYaml), 3, api::VectorEnvOptions{.settings = {{"threads", 2}}});
  batches.emplace_back(api::Config::from_text(kRunYaml), 3, api::VectorEnvOptions{.split = "eval"});
  batches.emplace_back(api::Config::from_text("{seed: 9, env: " + kEnvKeys + "}"), api::EpisodeSet::generate(drawn_options()), 3);
  batches.emplace_back(
      api::Config::from_text("seed: 9", api::Settings(std::vector<std::string>{"task.max_steps=9"})),
      api::EpisodeSet::generate(drawn_options()), 3,
      api::VectorEnvOptions{
          .settings = {{"acoustics.rays", 4}, {"acoustics.early_order", 1}, {"acoustics.rir_length_s", 0.1}, {"acoustics.field", false}}});
  expected.reset();
  for (api::VectorEnv& batch : batches) batch.reset();
  for (int step = 0; step < 14; ++step) {
    const auto actions = actions_of(step, 3);
    expected.step(actions);
    for (std::size_t b = 0; b < batches.size(); ++b) {
      api::VectorEnv& batch = batches[b];
      batch.step(actions);
      ASSERT_EQ(batch.sensors().size(), expected.sensors().size());
      for (const SensorSpec& sensor : expected.sensors()) {
        EXPECT_TRUE(same_bytes(batch.rows(sensor.name), expected.rows(sensor.name))) << sensor.name << ", batch " << b << ", step " << step;
        EXPECT_TRUE(same_bytes(batch.final_rows(sensor.name), expected.final_rows(sensor.name)));
      }
      EXPECT_TRUE(std::ranges::equal(batch.rewards(), expected.rewards()));
      EXPECT_TRUE(std::ranges::equal(batch.truncated(), expected.truncated()));
      ASSERT_EQ(batch.finished().size(), expected.finished().size());
      for (std::size_t i = 0; i < expected.finished().size(); ++i) {
        EXPECT_EQ(batch.finished()[i].distance_to_goal_m, expected.finished()[i].metrics.dtg_m);
        EXPECT_EQ(batch.finished()[i].steps, 9);
      }
      EXPECT_EQ(batch.episode_index(1), expected.agent(1).episode_index);
    }
  }
}

TEST(ApiVectorEnv, TypedRowsAndTheTableAgree) {
  const api::VectorEnv envs(api::Config::from_text(kBatchYaml), 2,
                            {.settings = {{"observation.rgb", true}, {"observation.collision", true}}});
  for (const api::SensorInfo& sensor : envs.sensors()) {
    if (sensor.type != api::SensorType::float32) continue;
    EXPECT_EQ(envs.rows_as<float>(sensor.name).size(), 2 * sensor.count()) << sensor.name;
  }
  EXPECT_EQ(envs.rows_as<std::uint8_t>("rgb").size(), envs.rows("rgb").size());
  EXPECT_THROW((void)envs.rows_as<float>("rgb"), std::invalid_argument);
  EXPECT_THROW((void)envs.rows_as<float>("smell"), std::invalid_argument);
  EXPECT_TRUE(envs.rows("smell").empty());
}

TEST(ApiVectorEnv, SnapshotsGoOnInAnotherEnvAndStatesInAnotherBatch) {
  const auto config = api::Config::from_text(kBatchYaml);
  api::VectorEnv envs(config, 2), other(config, 2);
  envs.reset();
  other.reset();
  for (int step = 0; step < 4; ++step) envs.step(actions_of(step, 2));
  other.restore_state(envs.save_state());
  envs.step(actions_of(7, 2));
  other.step(actions_of(7, 2));
  EXPECT_TRUE(same_bytes(envs.rows("depth"), other.rows("depth")));
  other.restore(1, envs.snapshot(0));
  EXPECT_EQ(other.pose(1).position, envs.pose(0).position);
  EXPECT_EQ(other.pose(1).heading_rad, envs.pose(0).heading_rad);
  EXPECT_EQ(other.scene_name(1), envs.scene_name(0));
  EXPECT_FALSE(message_of<InputError>([&] { other.restore_state("damaged"); }).empty());
}

TEST(ApiVectorEnv, ANamedEpisodeHasTheBitsOfItsTurn) {
  const auto config = api::Config::from_text(kBatchYaml);
  const api::VectorEnvOptions once{.settings = {{"order", "once"}, {"autoreset", "off"}}};
  api::VectorEnv in_turn(config, 1, once), named(config, 2, once);
  const std::uint8_t mask[1] = {1};
  for (int episode = 0; episode < 6; ++episode) {
    in_turn.reset(mask);
    named.begin_episode(1, static_cast<std::uint64_t>(episode));
    ASSERT_EQ(named.episode_index(1), in_turn.episode_index(0));
    EXPECT_EQ(named.active()[0], 0) << "the other env is not in an episode";
    for (int step = 0; step < 3; ++step) {
      for (const api::SensorInfo& sensor : in_turn.sensors()) {
        const std::size_t bytes = in_turn.rows(sensor.name).size();
        EXPECT_TRUE(same_bytes(in_turn.rows(sensor.name), named.rows(sensor.name).subspan(bytes, bytes))) << sensor.name << " " << episode;
      }
      const std::vector<std::int32_t> action = actions_of(step, 1);
      in_turn.step(action);
      named.send(std::vector<std::int32_t>{1}, action);
      named.recv(1);
    }
  }
  EXPECT_THROW(named.begin_episode(1, 6), std::invalid_argument);
  EXPECT_THROW(named.begin_episode(2, 0), std::out_of_range);
}

// Two envs that took part in a named episode, before the first one or between two, go on as those of a batch that knows of none.
TEST(ApiVectorEnv, ANamedEpisodeLeavesTheSequenceOfItsEnvAsItIs) {
  for (const char* order : {"random", "once"})
    for (const bool is_begun_before : {true, false})
      for (const char* autoreset : {"off", "next_step"}) {
        SCOPED_TRACE(testing::Message() << order << " " << autoreset << " " << is_begun_before);
        const auto config = api::Config::from_text(kBatchYaml);
        const api::VectorEnvOptions options{.settings = {{"order", order}, {"autoreset", autoreset}}};
        api::VectorEnv plain(config, 2, options), named(config, 2, options);
        const std::vector<std::uint8_t> both{1, 1};
        if (!is_begun_before) {
          plain.reset();
          named.reset();
        }
        for (int turn = 0; turn < 3; ++turn) {
          const RandomStream random(41, Purpose::test, static_cast<std::uint32_t>(turn));
          for (int env = 0; env < 2; ++env) named.begin_episode(env, random.below(6, static_cast<std::uint32_t>(env)));
          if (turn == 1) named.begin_episode(0, 5);  // two in a row
          plain.reset(both);
          if (autoreset == std::string("off") || turn == 0) {
            named.reset(both);
          } else {
            named.step(std::vector<std::int32_t>{0, 0});
            named.step(std::vector<std::int32_t>{0, 0});  // begins the next ones
          }
          for (std::size_t env = 0; env < 2; ++env) {
            ASSERT_EQ(named.active()[env], plain.active()[env]) << env;
            const int row = static_cast<int>(env);
            EXPECT_TRUE(plain.active()[env] == 0 || named.episode_index(row) == plain.episode_index(row)) << env;
          }
          for (const api::SensorInfo& sensor : plain.sensors())
            EXPECT_TRUE(same_bytes(named.rows(sensor.name), plain.rows(sensor.name))) << sensor.name << ", turn " << turn;
        }
      }
}

TEST(ApiVectorEnv, APlacedAgentSeesAndHearsAsOneWhoseEpisodeBeginsThere) {
  const auto config = api::Config::from_text(kBatchYaml);
  const api::VectorEnvOptions off{.settings = {{"autoreset", "off"}}};
  api::VectorEnv envs(config, 2, off);
  for (std::uint64_t episode = 0; episode < 6; ++episode) {
    envs.begin_episode(0, episode);
    envs.begin_episode(1, episode);
    const api::AgentPose start = envs.pose(0);
    for (int step = 0; step < 4; ++step) {
      envs.send(std::vector<std::int32_t>{1}, actions_of(step, 1));
      envs.recv(1);
    }
    ASSERT_TRUE(start.position != envs.pose(1).position || start.heading_rad != envs.pose(1).heading_rad);
    envs.place(1, start, 0);
    EXPECT_EQ(envs.pose(1).position, start.position);
    for (const api::SensorInfo& sensor : envs.sensors()) {
      const std::size_t bytes = envs.rows(sensor.name).size() / 2;
      EXPECT_TRUE(same_bytes(envs.rows(sensor.name).first(bytes), envs.rows(sensor.name).subspan(bytes))) << sensor.name << " " << episode;
    }
    EXPECT_THAT(message_of<std::logic_error>([&] { static_cast<void>(envs.snapshot(1)); }), HasSubstr("placed"));
    EXPECT_THROW(static_cast<void>(envs.save_state()), std::logic_error);
    EXPECT_FALSE(envs.snapshot(0).empty());
  }
  envs.begin_episode(1, 0);
  EXPECT_FALSE(envs.snapshot(1).empty()) << "another episode has begun";
}

TEST(ApiVectorEnv, APlacedAgentWalksOnFromThereAndIsScoredThere) {
  const auto config = api::Config::from_text(kBatchYaml);
  api::VectorEnv envs(config, 1, {.settings = {{"autoreset", "off"}}});
  envs.begin_episode(0, 2);
  const api::Navigation floor = envs.navigation(0);
  const api::Episode episode = api::EpisodeSet::generate(drawn_options())[2];
  for (std::uint32_t draw = 0; draw < 20; ++draw) {
    envs.begin_episode(0, 2);
    const api::Vec3 place = floor.random_point(17, draw);
    envs.place(0, {place, 0.3 * draw}, 3);
    EXPECT_NEAR(envs.pose(0).position.x, place.x, 1e-6);
    EXPECT_NEAR(envs.pose(0).position.z, place.z, 1e-6);
    EXPECT_DOUBLE_EQ(envs.pose(0).heading_rad, 0.3 * draw);
    envs.step(std::vector<std::int32_t>{0});
    ASSERT_EQ(envs.finished().size(), 1u);
    EXPECT_NEAR(envs.finished()[0].distance_to_goal_m, floor.distance_m(place, episode.goal).value(), 1e-6);
    EXPECT_EQ(envs.finished()[0].steps, 4);
  }
}

TEST(ApiVectorEnv, PlacesThatCannotBeTakenAreRefusedAndNothingMoves) {
  const auto config = api::Config::from_text(kBatchYaml);
  api::VectorEnv envs(config, 1, {.settings = {{"autoreset", "off"}}});
  EXPECT_THROW(envs.place(0, {}, 0), std::logic_error) << "no episode";
  envs.begin_episode(0, 1);
  const api::AgentPose start = envs.pose(0);
  EXPECT_THAT(message_of<InputError>([&] { envs.place(0, {{1000, 0, 0}, 0}, 0); }), HasSubstr("off the walkable surface"));
  EXPECT_FALSE(message_of<InputError>([&] { envs.place(0, {{std::nan(""), 0, 0}, 0}, 0); }).empty());
  EXPECT_THROW(envs.place(0, start, 9), std::invalid_argument) << "max_steps is 9";
  EXPECT_THROW(envs.place(0, start, -1), std::invalid_argument);
  EXPECT_EQ(envs.pose(0).position, start.position);
  EXPECT_FALSE(envs.snapshot(0).empty());
  envs.step(std::vector<std::int32_t>{0});
  EXPECT_THROW(envs.place(0, start, 0), std::logic_error) << "its episode has ended";
}

TEST(ApiVectorEnv, EnvsUnderWayComeBackAsTheyWereSent) {
  const auto config = api::Config::from_text(kBatchYaml);
  api::VectorEnv envs(config, 3), whole(config, 3);
  envs.reset();
  whole.reset();
  const auto actions = actions_of(0, 3);
  const std::vector<std::int32_t> first{2, 0}, first_actions{actions[2], actions[0]}, second{1}, second_actions{actions[1]};
  envs.send(first, first_actions);
  envs.send(second, second_actions);
  EXPECT_EQ(envs.recv(2, true), (std::vector<std::int32_t>{0, 2}));
  EXPECT_EQ(envs.recv(1, true), second);
  whole.step(actions);
  EXPECT_TRUE(same_bytes(envs.rows("depth"), whole.rows("depth")));
}

TEST(ApiVectorEnv, ResetsByMaskAndSeed) {
  const auto config = api::Config::from_text(kBatchYaml);
  api::VectorEnv envs(config, 2);
  envs.reset();
  const std::vector<std::uint8_t> both{1, 1};
  const std::vector<std::uint64_t> seeds{5, 5};
  envs.reset(both, seeds);
  EXPECT_EQ(envs.pose(0).position, envs.pose(1).position);
  EXPECT_EQ(envs.num_agents(), 1);
  EXPECT_EQ(envs.autoreset(), "same_step");
  EXPECT_THAT(envs.config_text(), HasSubstr("max_steps: 9"));
}

TEST(ApiVectorEnv, WrongInputIsRefused) {
  const auto refusal = [](const std::string& yaml, int num_envs = 1, const api::VectorEnvOptions& options = {}) {
    return message_of<InputError>([&] { api::VectorEnv(api::Config::from_text(yaml), num_envs, options); });
  };
  EXPECT_THAT(refusal("task: {}"), HasSubstr("episodes"));
  EXPECT_THAT(refusal(kBatchYaml, 0), HasSubstr("num_envs = 0"));
  EXPECT_THAT(refusal(kBatchYaml, 1, {.settings = {{"threds", 1}}}), HasSubstr("threads"));
  EXPECT_THAT(refusal(kRunYaml, 1, {.split = "test"}), HasSubstr("test"));
  EXPECT_THAT(refusal("task: [", 1), HasSubstr("config"));
  api::VectorEnv envs(api::Config::from_text(kBatchYaml), 2);
  EXPECT_THROW(envs.step(std::vector<std::int32_t>{1, 1}), std::logic_error);  // before reset
  envs.reset();
  EXPECT_THROW(envs.step(std::vector<std::int32_t>{1}), std::invalid_argument);
  EXPECT_THROW((void)envs.pose(2), std::out_of_range);
}

TEST(ApiEpisodes, AreThoseOfTheSameKeysInAConfig) {
  const auto drawn = api::EpisodeSet::generate(drawn_options());
  EXPECT_EQ(drawn.hash(), read_batch(kBatchYaml, "text", {}, {}, "train").set->hash);
  const TempFolder folder;
  drawn.save(folder / "set.json.gz");
  const auto read = api::EpisodeSet::load(folder / "set.json.gz");
  EXPECT_EQ(read.hash(), drawn.hash());
  ASSERT_EQ(read.size(), 6u);
  EXPECT_EQ(read[5].scene, "shoebox:6x3x5@0.3");
  EXPECT_EQ(read[5].sound, "synth:telephone");
  EXPECT_GE(read[5].distance_m, 1);
  EXPECT_EQ(read[5].start, drawn[5].start);
  EXPECT_THROW((void)read[6], std::out_of_range);
}

TEST(ApiEpisodes, WrongInputIsRefused) {
  api::EpisodeOptions options = drawn_options();
  options.scenes.clear();
  EXPECT_THAT(message_of<InputError>([&] { (void)api::EpisodeSet::generate(options); }), HasSubstr("scenes"));
  options = drawn_options();
  options.settings.set("filter.min_geodesic", 2);
  EXPECT_THAT(message_of<InputError>([&] { (void)api::EpisodeSet::generate(options); }), HasSubstr("min_geodesic"));
  options = drawn_options();
  options.settings.set("filter.min_geodesic_m", 50);
  options.settings.set("filter.max_tries", 5);
  EXPECT_FALSE(message_of<InputError>([&] { (void)api::EpisodeSet::generate(options); }).empty());
  EXPECT_THAT(message_of<InputError>([] { (void)api::EpisodeSet::load("no_such.json"); }), HasSubstr("no_such.json"));
}

TEST(ApiVectorEnv, AWaitForStepsHandsNothingBack) {
  api::VectorEnv waited(api::Config::from_text(kBatchYaml), 3), expected(api::Config::from_text(kBatchYaml), 3);
  const std::vector<std::int32_t> envs{2, 0, 1};
  for (api::VectorEnv* batch : {&waited, &expected}) batch->reset();
  for (int step = 0; step < 12; ++step) {
    const bool as_sent = step % 2 == 1;
    for (api::VectorEnv* batch : {&waited, &expected}) batch->send(envs, actions_of(step, 3));
    waited.wait_ready(1 + step % 3, as_sent);
    waited.wait_ready(3, as_sent);
    EXPECT_THROW(waited.send(std::vector<std::int32_t>{0}, actions_of(step, 1)), std::logic_error) << "still under way";
    EXPECT_THROW(waited.reset(), std::logic_error);
    EXPECT_THROW(waited.wait_ready(4, as_sent), std::invalid_argument);
    EXPECT_EQ(waited.recv(3, as_sent), expected.recv(3, as_sent));
    EXPECT_EQ(waited.finished().size(), expected.finished().size());
    for (const api::SensorInfo& sensor : expected.sensors())
      EXPECT_TRUE(same_bytes(waited.rows(sensor.name), expected.rows(sensor.name))) << sensor.name << ", step " << step;
    EXPECT_THROW(waited.wait_ready(1, as_sent), std::invalid_argument) << "nothing is under way";
  }
}

TEST(ApiVectorEnv, BackgroundWorkEndsByItself) {
  api::VectorEnv batch(api::Config::from_text(kBatchYaml), 3);
  batch.reset();
  batch.send(std::vector<std::int32_t>{0, 1, 2}, actions_of(0, 3));
  EXPECT_TRUE(wait_until([&] { return !batch.works_in_background(); }));
  EXPECT_EQ(batch.recv(3).size(), 3u) << "and stays to be received";
  batch.step(actions_of(1, 3));
  EXPECT_TRUE(wait_until([&] { return !batch.works_in_background(); }));
}

}  // namespace
}  // namespace earshot
