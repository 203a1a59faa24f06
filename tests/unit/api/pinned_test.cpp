// SPDX-License-Identifier: Apache-2.0
// The pinned hashes of a hundred poses and of two hundred steps, which tests/pinned/promise_test.cpp has from the engine and
// python/tests/test_bits.py from Python and the command line.
#include <gtest/gtest.h>

#include "earshot/env.h"
#include "earshot/scene.h"
#include "tests/support/files/pinned_bits.h"

namespace earshot {
namespace {

TEST(ApiPinnedBits, AHundredPoses) {
  const api::Scene scene("house:1,rooms=3,area_m2=60", {.preset = "fast", .settings = {{"rir_length_s", 0.3}}});
  std::vector<api::Listener> listeners;
  for (int pose = 0; pose < 100; ++pose)
    listeners.push_back({.position = {1.013 + 0.2471 * (pose % 10), 1.5, 1.029 + 0.2437 * (pose / 10)}, .heading_deg = 36.0 * (pose % 10)});
  pinned::BitHash bits;
  for (const api::Rir& rir : scene.source({2, 1.5, 2}).render_all(listeners, {.channels = "binaural"})) bits.add(rir.samples);
  pinned::expect_pinned_rays("rirs_100_poses", bits, {pinned::transforms()});
}

#ifdef NDEBUG
TEST(ApiPinnedBits, TwoHundredSteps) {
  constexpr int envs = 3;
  const std::string folder = (source_dir() / "tests/pinned").string();
  const auto config = api::Config::from_file(folder + "/batch.yaml");
  api::VectorEnv batch(config, api::EpisodeSet::load(folder + "/episodes.json"), envs, {.settings = {{"threads", 2}}});
  batch.reset();
  pinned::BitHash bits;
  std::vector<std::int32_t> actions(envs);
  for (int step = 0; step < 200; ++step) {
    for (int env = 0; env < envs; ++env) actions[static_cast<std::size_t>(env)] = 1 + (step * 3 + env * 5) % 7 % 3;
    batch.step(actions);
    for (const api::SensorInfo& sensor : batch.sensors()) bits.add(batch.rows(sensor.name));
    bits.add(batch.rewards()).add(std::as_bytes(batch.terminated())).add(std::as_bytes(batch.truncated()));
  }
  pinned::expect_pinned_rays("batch_200_steps", bits, {pinned::transforms()});
}
#endif

}  // namespace
}  // namespace earshot
