// SPDX-License-Identifier: Apache-2.0
#include "policy/actor_critic.h"

#include <gtest/gtest.h>

#include <cmath>

#include "sim/base/errors.h"
#include "tests/support/largest.h"

namespace earshot {
namespace {

ObservationSpec spec_of(int size_px, bool depth = true, bool spectrogram = true, bool pointgoal = false) {
  ObservationSpec spec;
  spec.depth = depth;
  spec.spectrogram = spectrogram;
  spec.pointgoal = pointgoal;
  spec.camera.width_px = spec.camera.height_px = size_px;
  return spec;
}

PolicyConfig small_config() {
  PolicyConfig config;
  config.hidden_size = 24;
  config.visual_features = config.audio_features = 16;
  config.conv_channels = 4;
  config.seed = 5;
  return config;
}

ObservationTensors random_observations(const ObservationSpec& spec, std::int64_t rows) {
  ObservationTensors seen;
  for (const SensorSpec& sensor : sensor_table(spec, 1)) {
    const std::vector<std::int64_t> sizes = sizes_of(sensor, {rows});
    seen.add(sensor.name, sensor.type == SensorType::float32 ? torch::rand(sizes) : torch::zeros(sizes, scalar_type(sensor.type)));
  }
  return seen;
}

std::int64_t parameters_of(const torch::OrderedDict<std::string, torch::Tensor>& named, const std::string& prefix) {
  std::int64_t count = 0;
  for (const auto& item : named)
    if (item.key().starts_with(prefix)) count += item.value().numel();
  return count;
}

TEST(ActorCritic, HasTheParametersOfThePublishedNetwork) {
  ActorCritic policy(spec_of(128), PolicyConfig{});  // docs/reference/formats.md, section 6.5
  const auto named = policy->named_parameters();
  EXPECT_EQ(parameters_of(named, "visual."), 1252000);
  EXPECT_EQ(parameters_of(named, "audio."), 1335520);
  EXPECT_EQ(parameters_of(named, "rnn."), 2362368);
  EXPECT_EQ(parameters_of(named, "actor.") + parameters_of(named, "critic."), 2565);
  EXPECT_EQ(policy->num_parameters(), 4952453);

  ObservationSpec rich = spec_of(128);
  rich.sound.sample_rate_hz = 44100;
  rich.sound.num_samples = 44100;  // 276 frames, 69 columns: the large layers
  EXPECT_EQ(ActorCritic(rich, PolicyConfig{})->num_parameters(), 4346693);
}

TEST(ActorCritic, WorksForEverySetOfSensors) {
  torch::manual_seed(1);
  for (const int bits : {1, 2, 3, 4, 5, 6, 7}) {
    const ObservationSpec spec = spec_of(64, bits & 1, bits & 2, bits & 4);
    ActorCritic policy(spec, small_config());
    const PolicyOutput output = policy->step(random_observations(spec, 3), torch::zeros({3, 24}), torch::ones({3}));
    EXPECT_EQ(output.logits.sizes(), (std::vector<std::int64_t>{3, 4}));
    EXPECT_EQ(output.value.sizes(), (std::vector<std::int64_t>{3}));
    EXPECT_EQ(output.hidden.sizes(), (std::vector<std::int64_t>{3, 24}));
    EXPECT_TRUE(torch::isfinite(output.value).all().item<bool>());
  }
}

TEST(ActorCritic, EverySensorMatters) {
  torch::manual_seed(2);
  ObservationSpec spec = spec_of(64, true, true, true);
  spec.gps_compass = spec.pose = spec.collision = spec.previous_action = spec.rgb = spec.topdown_map = true;
  spec.cameras = {{.name = "left", .config = {.width_px = 64, .height_px = 64, .yaw_deg = 90}, .depth = true, .normals = true}};
  ActorCritic policy(spec, small_config());
  const torch::Tensor hidden = torch::zeros({1, 24}), not_done = torch::ones({1});
  const ObservationTensors seen = random_observations(spec, 1);
  const torch::Tensor value = policy->step(seen, hidden, not_done).value;
  for (const auto& [name, rows] : seen.sensors) {
    ObservationTensors other = seen;
    other.at(name) = rows + (name == "rgb" || name == "topdown_map" ? 200 : 1);
    EXPECT_GT(largest(policy->step(other, hidden, not_done).value - value), 1e-4);
  }
}

TEST(ActorCritic, RefusesASensorThatItCannotRead) {
  ObservationSpec spec = spec_of(64);
  spec.waveform = true;
  EXPECT_THROW(ActorCritic(spec, small_config()), InputError);
  spec.waveform = false;
  spec.semantic = true;
  EXPECT_THROW(ActorCritic(spec, small_config()), InputError);
}

TEST(ActorCritic, SequenceEqualsStepsAcrossEpisodeStarts) {
  torch::manual_seed(3);
  const std::int64_t T = 9, B = 3;
  const ObservationSpec spec = spec_of(64, true, true, true);
  ActorCritic policy(spec, small_config());
  const ObservationTensors seen = random_observations(spec, T * B);
  torch::Tensor not_done = torch::ones({T, B});
  not_done[0][2] = not_done[4][0] = not_done[4][1] = not_done[8][1] = 0;
  const torch::Tensor first = torch::randn({B, 24});
  const PolicyOutput whole = policy->sequence(seen, first, not_done);

  torch::Tensor hidden = first;
  for (std::int64_t t = 0; t < T; ++t) {
    const auto row = [&](const torch::Tensor& sensor) { return sensor.slice(0, t * B, (t + 1) * B); };
    const PolicyOutput row_output = policy->step(seen.map(row), hidden, not_done[t]);
    EXPECT_LT(largest(row_output.logits - row(whole.logits)), 1e-6);  // float32 sums of another order, values around 0.1
    EXPECT_LT(largest(row_output.value - row(whole.value)), 1e-6);
    hidden = row_output.hidden;
  }
  EXPECT_LT(largest(hidden - whole.hidden), 1e-6);

  // The same sequence without the restarts is another one: the comparison above can fail.
  EXPECT_GT(largest(policy->sequence(seen, first, torch::ones({T, B})).value - whole.value), 1e-3);
}

TEST(ActorCritic, WithoutMemoryGoesByTheObservationAlone) {
  torch::manual_seed(6);
  const std::int64_t T = 4, B = 2;
  const ObservationSpec spec = spec_of(64);
  PolicyConfig config = small_config();
  ActorCritic remembers(spec, config);
  config.recurrent = false;
  ActorCritic forgets(spec, config);
  const ObservationTensors seen = random_observations(spec, T * B);
  const torch::Tensor ones = torch::ones({T, B}), zeros = torch::zeros({T, B});
  const torch::Tensor state = torch::randn({B, 24}), other = torch::randn({B, 24});
  EXPECT_TRUE(torch::equal(forgets->sequence(seen, state, ones).logits, forgets->sequence(seen, other, ones).logits));
  EXPECT_GT(largest(remembers->sequence(seen, state, ones).logits - remembers->sequence(seen, other, ones).logits), 1e-4);
  // Same weights, and every step the first of an episode: the same agent.
  EXPECT_TRUE(torch::equal(forgets->sequence(seen, state, ones).logits, remembers->sequence(seen, state, zeros).logits));
}

TEST(ActorCritic, GradientsReachEveryParameter) {
  torch::manual_seed(4);
  const ObservationSpec spec = spec_of(64, true, true, true);
  ActorCritic policy(spec, small_config());
  const PolicyOutput output = policy->sequence(random_observations(spec, 8), torch::randn({2, 24}), torch::ones({4, 2}));
  (output.logits.square().sum() + output.value.sum()).backward();
  for (const auto& item : policy->named_parameters()) {
    ASSERT_TRUE(item.value().grad().defined()) << item.key();
    EXPECT_GT(largest(item.value().grad()), 0) << item.key();
  }
}

TEST(ActorCritic, InitialWeightsAreAFunctionOfTheSeedAlone) {
  torch::manual_seed(1);
  ActorCritic one(spec_of(64), small_config());
  torch::manual_seed(2);
  torch::rand({7});
  ActorCritic same(spec_of(64), small_config());
  PolicyConfig reseeded = small_config();
  reseeded.seed = 6;
  ActorCritic other(spec_of(64), reseeded);
  const auto a = one->named_parameters(), b = same->named_parameters(), c = other->named_parameters();
  for (const auto& item : a) {
    EXPECT_TRUE(item.value().equal(b[item.key()])) << item.key();
    if (item.value().dim() > 1) {
      EXPECT_FALSE(item.value().equal(c[item.key()])) << item.key();
    } else {
      EXPECT_EQ(largest(item.value()), 0) << item.key();
    }
  }
}

TEST(ActorCritic, InitialWeightsHaveTheStatedShape) {
  PolicyConfig config;
  config.hidden_size = 64;
  ActorCritic policy(spec_of(64, false, true), config);
  const auto named = policy->named_parameters();
  // 2496 x 512 normal numbers of variance 2 / 2496: the standard error of their variance is sqrt(2 / n) = 0.13 %, four of them 0.5 %.
  EXPECT_NEAR(named["audio.linear.weight"].square().mean().item<double>() * 2496 / 2, 1.0, 0.005);
  // 32 x 50 of variance 2 / 50: four standard errors are 14 %.
  EXPECT_NEAR(named["audio.conv1.weight"].square().mean().item<double>() * 50 / 2, 1.0, 0.14);
  for (const char* name : {"rnn.weight_ih", "rnn.weight_hh"})
    for (const torch::Tensor& gate : named[name].detach().chunk(3))  // [64, 512] or [64, 64]: orthonormal rows, gate by gate
      EXPECT_LT(largest(gate.mm(gate.t()) - torch::eye(64)), 1e-5) << name;
  const torch::Tensor actor = named["actor.weight"].detach(), critic = named["critic.weight"].detach();
  EXPECT_LT(largest(actor.mm(actor.t()) * 1e4 - torch::eye(4)), 1e-5);
  EXPECT_NEAR(critic.norm().item<double>(), 1.0, 1e-5);
}

TEST(ActorCritic, AtFirstStopIsAsRareAsAsked) {
  torch::manual_seed(5);
  const ObservationSpec spec = spec_of(64);
  for (const double logit : {0.0, -4.0}) {
    PolicyConfig config = small_config();
    config.initial_stop_logit = logit;
    ActorCritic policy(spec, config);
    const torch::Tensor p = policy->step(random_observations(spec, 1), torch::zeros({1, 24}), torch::ones({1})).logits[0].softmax(0);
    const double expected = std::exp(logit) / (std::exp(logit) + 3);  // 1/4, and 1/165: the weights of the actor, gain 0.01, hardly matter
    EXPECT_NEAR(p[0].item<double>() / expected, 1.0, 0.05);
    for (int other = 1; other < 4; ++other) EXPECT_NEAR(p[other].item<double>() * 3 / (1 - expected), 1.0, 0.05);
  }
}

TEST(ActorCritic, RefusesWhatCannotWork) {
  EXPECT_THROW(ActorCritic(spec_of(128, false, false, false), PolicyConfig{}), InputError);
  // 32: 7 after the first convolution, 2 after the second, which the third (3 x 3) cannot take.  36: 8, 3, 1.
  EXPECT_THROW(ActorCritic(spec_of(32), small_config()), InputError);
  EXPECT_NO_THROW(ActorCritic(spec_of(36), small_config()));
  try {
    ActorCritic(spec_of(32), small_config());
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("32 x 32"), std::string::npos) << error.what();
  }
  PolicyConfig config;
  config.hidden_size = 0;
  EXPECT_THROW(validate(config), InputError);
  config.hidden_size = 1 << 20;
  EXPECT_THROW(validate(config), InputError);
  config = PolicyConfig{};
  config.initial_stop_logit = -1000;
  EXPECT_THROW(validate(config), InputError);
  EXPECT_NO_THROW(validate(PolicyConfig{}));
}

TEST(ActorCritic, ReadsItsConfig) {
  ConfigReader reader = ConfigReader::from_text(
      "{hidden_size: 128, visual_features: 64, audio_features: 32, conv_channels: 16, seed: 9, initial_stop_logit: -3, recurrent: false}",
      "test");
  PolicyConfig config;
  read(reader, config);
  reader.finish();
  EXPECT_EQ(config.hidden_size, 128);
  EXPECT_EQ(config.visual_features, 64);
  EXPECT_EQ(config.audio_features, 32);
  EXPECT_EQ(config.conv_channels, 16);
  EXPECT_EQ(config.seed, 9u);
  EXPECT_EQ(config.initial_stop_logit, -3);
  EXPECT_FALSE(config.recurrent);
}

TEST(ActorCritic, ArchitectureTellsWeightsApart) {
  const auto line = [](const ObservationSpec& spec, const PolicyConfig& config) { return ActorCritic(spec, config)->architecture(); };
  const std::string base = line(spec_of(64), small_config());
  EXPECT_EQ(base, "actor-critic v1: depth 64x64x1 -> 16, spectrogram 65x26x2 -> 16, conv 4, gru 24, actions 4");
  PolicyConfig reseeded = small_config();
  reseeded.seed = 77;
  EXPECT_EQ(line(spec_of(64), reseeded), base);
  PolicyConfig wider = small_config();
  wider.hidden_size = 25;
  PolicyConfig forgetful = small_config();
  forgetful.recurrent = false;
  for (const std::string& other : {line(spec_of(64), forgetful), line(spec_of(72), small_config()), line(spec_of(64), wider),
                                   line(spec_of(64, true, false), small_config()), line(spec_of(64, true, true, true), small_config())})
    EXPECT_NE(other, base);
}

}  // namespace
}  // namespace earshot
