// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "envs/batch/batched_env.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/source_field/source_field.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/audio/stream/sound_stream.h"
#include "sim/base/random.h"
#include "sim/scene/scene.h"
#include "sim/vision/embree_camera.h"
#include "tests/support/envs/env_fixture.h"
#include "tests/support/files/pinned_bits.h"

/// Comparing two runs of one build cannot see a commit that moves all bits in both; these compare with bits that are written down.
namespace earshot {
namespace {

struct RirCase {
  std::string scene;
  AcousticConfig config;
  ListenerLayout layout = ListenerLayout::named("binaural");
  glm::vec3 source{0}, listener{0};
};

pinned::BitHash bits_of_rir(const RirCase& c) {
  const AcousticScene scene(std::make_shared<const Scene>(load_scene(c.scene)), c.config);
  const EarlyCandidates candidates(scene, c.source);
  const auto field = uses_source_field(scene) ? build_source_field(scene, candidates) : nullptr;
  EnergyResponse response;
  compute_energy_response(scene, candidates, field.get(), c.listener, response);
  RirSynthesizer synthesizer(make_synthesis_tables(scene.config(), scene.bands(), c.layout, Hrtf::rigid_sphere(c.config.sample_rate_hz)));
  Rir rir;
  synthesizer.render(response, 0.3, 5, rir);
  EXPECT_FALSE(rir.samples.empty());
  return pinned::BitHash().add(response.late.values()).add(rir.samples);
}

TEST(PinnedBits, RirOfARoom) {
  RirCase c{.scene = "shoebox:6x3x5@0.2", .config = acoustic_preset("fast"), .source = {1.2f, 1.5f, 1.1f}, .listener = {4.8f, 1.6f, 3.9f}};
  pinned::expect_pinned_rays("rir_room_fast", bits_of_rir(c), {pinned::transforms()});
}

TEST(PinnedBits, RirOfAHouseFromASourceField) {
  RirCase c{.scene = "house:7", .config = acoustic_preset("fast"), .source = {2, 1.5f, 2}, .listener = {10, 1.5f, 5}};
  c.config.field = Switch::on;
  c.config.field_photons = 2048;
  c.config.rir_length_s = 0.6f;
  pinned::expect_pinned_rays("rir_house_field", bits_of_rir(c), {pinned::transforms()});
}

TEST(PinnedBits, RirOfTwoRoomsFromBothEnds) {
  RirCase c{.scene = "house:2,rooms=2,area_m2=30",
            .config = acoustic_preset("high"),
            .layout = ListenerLayout::ambisonics(2),
            .source = {1.5f, 1.2f, 1.5f},
            .listener = {3.5f, 1.5f, 3.5f}};
  c.config.field = Switch::off;
  c.config.rays = c.config.source_rays = 512;
  c.config.rir_length_s = 0.4f;
  pinned::expect_pinned_rays("rir_two_rooms_bidirectional", bits_of_rir(c), {pinned::transforms()});
}

TEST(PinnedBits, SoundStream) {
  const StreamConfig config{.max_rir_samples = 3000, .max_block_samples = 2400, .crossfade_samples = 800};
  StreamConvolver convolver(config, 2);
  std::vector<float> first(2 * 3000), second(first.size());
  const RandomStream random(7, Purpose::scatter, 1);
  for (std::size_t i = 0; i < first.size(); ++i) {
    const auto u = random.uniform2(static_cast<std::uint32_t>(i));
    const float envelope = std::exp(-static_cast<float>(i % 3000) / 500.f);
    first[i] = envelope * (u[0] - 0.5f);
    second[i] = envelope * (u[1] - 0.5f);
  }
  const SoundClip clip = synthesize_sound("synth:bird", config.sample_rate_hz);
  std::vector<float> block(2 * 2400);
  pinned::BitHash bits;
  StreamPosition position;
  for (int step = 0; step < 6; ++step) {
    convolver.convolve(clip, position, step % 2 == 0 ? first : second, step % 2 == 0 ? second : first, 3000, 2400, block);
    bits.add(block);
    position.sample += 2400;
  }
  // No rays; the transforms choose their vectors from the same processor.
  pinned::expect_pinned({"sound_stream", pinned::toolchain({pinned::transforms()}), pinned::processor()}, bits);
}

TEST(PinnedBits, Depth) {
  const Scene scene = load_scene("house:7");
  const EmbreeCamera camera(sensor_of(CameraConfig{.width_px = 64, .height_px = 48}));
  std::vector<float> depth(64 * 48);
  pinned::BitHash bits;
  for (const double heading_rad : {0.0, 1.0, 2.5}) {
    camera.render(scene, nullptr, Pose{{2.5f, 0, 2.5f}, heading_rad}, {.depth = depth});
    bits.add(depth);
  }
  pinned::expect_pinned_rays("depth", bits, {});
}

TEST(PinnedBits, ObservationsAfterTwentySteps) {
  const EnvConfig config = quick_env_config();
  BatchedEnv env(config, quick_set(3), make_scene_cache(config), 4);
  env.reset();
  std::vector<std::int32_t> actions(4);
  for (std::int32_t step = 0; step < 20; ++step) {
    for (std::int32_t e = 0; e < 4; ++e) actions[static_cast<std::size_t>(e)] = 1 + (step * 3 + e * 5) % 7 % 3;
    env.step(actions);
  }
  pinned::BitHash bits;
  bits.add(float_rows(env, "depth"))
      .add(float_rows(env, "spectrogram"))
      .add(float_rows(env, "heard"))
      .add(float_rows(env, "pointgoal"))
      .add(env.rewards());
  pinned::expect_pinned_rays("observation_20_steps", bits, {pinned::transforms()});
}

}  // namespace
}  // namespace earshot
