// SPDX-License-Identifier: Apache-2.0
#include "envs/config/env_accuracy.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "envs/batch/batched_env.h"
#include "envs/scenes/scene_cache.h"
#include "sim/base/errors.h"
#include "tests/support/envs/env_fixture.h"

namespace earshot {
namespace {

using testing::HasSubstr;

/// Episodes in two boxes, one live and one dead, two goals in each.
EpisodeSet episodes_in_two_boxes(const EnvConfig& config) {
  const EpisodeFilter filter{.min_geodesic_m = 1.f, .max_geodesic_m = 100.f, .min_ratio = 1.f, .max_tries = 1000};
  EpisodeSet set;
  for (const char* scene_id : {"shoebox:6x3x5@0.15", "shoebox:5x3x4@0.4"}) {
    const auto scene = make_scene_cache(config)->scene(scene_id);
    for (Episode& episode : generate_episodes(scene_id, *scene->scene, scene->navmesh,
                                              {.task = config.task, .filter = filter, .sounds = {"synth:noise"}, .count = 2, .seed = 1}))
      set.episodes.push_back(std::move(episode));
  }
  set.hash = episode_set_hash(set.episodes);
  return set;
}

EnvConfig config_asking(const std::string& accuracy) {
  EnvConfig config = quick_env_config();
  config.acoustics = acoustic_preset("fast");
  config.acoustics.rir_length_s = 1.f;
  config.accuracy = accuracy;
  return config;
}

TEST(EnvAccuracy, WhatIsChosenKeepsThePromiseAgainstOtherPaths) {
  const EnvConfig asked = config_asking("t20=10%,edc=1.5dB");
  const EpisodeSet set = episodes_in_two_boxes(asked);
  const EnvAccuracy accuracy = plan_env_accuracy(asked, set);
  EXPECT_EQ(accuracy.scenes, 2);
  EXPECT_TRUE(accuracy.config.accuracy.empty());
  const AccuracyTarget target = AccuracyTarget::parse(asked.accuracy);
  EXPECT_LE(target.used(accuracy.plan.choice().predicted), 0.85);
  // What the planner does not choose is as it was.
  EXPECT_EQ(accuracy.config.acoustics.rir_length_s, 1.f);
  EXPECT_EQ(accuracy.config.acoustics.sh_order, asked.acoustics.sh_order);
  EXPECT_EQ(accuracy.config.task.max_steps, asked.task.max_steps);

  // At the goals that were planned for, at places between start and goal; paths of their own.
  const auto cache = make_scene_cache(accuracy.config);
  for (const std::size_t index : {0u, 2u}) {
    const Episode& episode = set.episodes[index];
    const auto source = cache->source(episode.scene_id, episode.goal_position, asked.task.source_height_m);
    const AcousticConfig& config = accuracy.config.acoustics;
    AcousticConfig other = config;
    other.seed = 77;
    const glm::vec3 ears(0, asked.task.ear_height_m, 0), start = source->scene->scene->to_local(episode.start_position);
    const glm::vec3 at = source->candidates.source();
    std::vector<glm::vec3> places;
    for (const float way : {0.f, 0.1f, 0.2f, 0.3f, 0.4f, 0.5f, 0.6f, 0.7f}) places.push_back((1 - way) * (start + ears) + way * at);
    AccuracyReference paths(source->scene->scene, other, at, places);
    paths.refine(target, 0.3, 256);
    EXPECT_LE(target.used(try_config(source->scene->scene, accuracy.plan.choice().method, config, at, paths, 4).measured), 1.0) << index;
  }
}

TEST(EnvAccuracy, EnvironmentsTakeWhatWasChosenAndNotTheTarget) {
  const EnvConfig asked = config_asking("t20=15%");
  const auto set = std::make_shared<const EpisodeSet>(episodes_in_two_boxes(asked));
  EXPECT_THROW(BatchedEnv(asked, set, make_scene_cache(asked), 2), InputError);
  const EnvConfig chosen = plan_env_accuracy(asked, *set).config;
  BatchedEnv env(chosen, set, make_scene_cache(chosen), 2);
  env.reset();
  env.step(std::vector<std::int32_t>{1, 1});
  float loudest = 0;
  for (const float sample : float_rows(env, "heard")) loudest = std::max(loudest, std::abs(sample));
  EXPECT_GT(loudest, 0.f);
}

TEST(EnvAccuracy, WhatCannotBeAskedIsRefused) {
  const auto read_config = [](const std::string& yaml) {
    EnvConfig config;
    ConfigReader reader = ConfigReader::from_text(yaml, "env.yaml");
    read(reader, config);
    reader.finish();
    validate(config);
    return config;
  };
  const auto refusal = [&](const std::string& yaml) -> std::string {
    try {
      read_config(yaml);
    } catch (const InputError& error) {
      return error.what();
    }
    return "taken";
  };
  EXPECT_EQ(read_config("accuracy: t20=10%\nacoustics: {preset: fast, rir_length_s: 0.3}").accuracy, "t20=10%");
  EXPECT_THAT(refusal("accuracy: t20=10%\nacoustics: {rays: 24}"), HasSubstr("rays: is a key that env.accuracy chooses"));
  EXPECT_THAT(refusal("accuracy: t20=10%\nacoustics: {field: on}"), HasSubstr("field: is a key that env.accuracy chooses"));
  EXPECT_THAT(refusal("accuracy: t60=10%"), HasSubstr("t60"));
  EXPECT_THAT(refusal("accuracy: t20=10%\nobservation: {spectrogram: false}"), HasSubstr("no effect"));
}

}  // namespace
}  // namespace earshot
