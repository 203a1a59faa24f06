// SPDX-License-Identifier: Apache-2.0
// One hash for 100 poses and one for 200 steps, over threads, fresh and restored; python/tests/test_bits.py compares with the same rows of
// bits.csv and with `earshot rir`.
#include <gtest/gtest.h>

#include <atomic>
#include <memory>
#include <numbers>
#include <string>
#include <thread>
#include <vector>

#include "envs/batch/batched_env.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/synthesis/carriers.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "sim/base/text/config_reader.h"
#include "sim/scene/scene.h"
#include "tests/support/files/pinned_bits.h"

namespace earshot {
namespace {

constexpr int kPoses = 100, kEnvs = 3;
#ifdef NDEBUG
constexpr int kSteps = 200;
#else
constexpr int kSteps = 40;  // the sanitizers see the same code; bits are compared with the pinned ones over 200 steps alone
#endif

/// In line with neither the walls nor the source: a path that runs exactly along the edge of two materials is reflected by either.
glm::dvec3 place(int pose) { return {1.013 + 0.2471 * (pose % 10), 1.5, 1.029 + 0.2437 * (pose / 10)}; }
double heading_rad(int pose) { return 36.0 * (pose % 10) * std::numbers::pi / 180; }

/// Binaural RIRs of all poses, rendered on `threads` threads.
std::vector<Rir> render_poses(int threads) {
  AcousticConfig config = acoustic_preset("fast");
  config.rir_length_s = 0.3f;
  const auto scene = std::make_shared<const Scene>(load_scene("house:1,rooms=3,area_m2=60"));
  const AcousticScene acoustics(scene, config);
  const EarlyCandidates candidates(acoustics, scene->to_local({2, 1.5, 2}));
  const auto tables = make_synthesis_tables(acoustics.config(), acoustics.bands(), ListenerLayout::named("binaural"),
                                            Hrtf::rigid_sphere(config.sample_rate_hz));
  std::vector<Rir> rirs(kPoses);
  std::atomic<int> next{0};
  const auto work = [&] {
    RirSynthesizer synthesizer(tables);
    EnergyResponse response;
    for (int pose = next++; pose < kPoses; pose = next++) {
      const glm::vec3 listener = scene->to_local(place(pose));
      compute_energy_response(acoustics, candidates, nullptr, listener, response);
      synthesizer.render(response, ListenerOrientation(heading_rad(pose)), {carrier_key(acoustics.hash(), candidates.source()), listener},
                         rirs[static_cast<std::size_t>(pose)]);
    }
  };
  std::vector<std::thread> helpers;
  for (int i = 1; i < threads; ++i) helpers.emplace_back(work);
  work();
  for (std::thread& helper : helpers) helper.join();
  return rirs;
}

TEST(PinnedBits, RirsOfAHundredPosesOnAnyNumberOfThreads) {
  pinned::BitHash first;
  for (const int threads : {1, 2, 4, 8}) {
    pinned::BitHash bits;
    for (const Rir& rir : render_poses(threads)) bits.add(rir.samples);
    if (threads == 1) first = bits;
    EXPECT_EQ(bits.hex(), first.hex()) << threads << " threads";
  }
  pinned::expect_pinned_rays("rirs_100_poses", first, {pinned::transforms()});
}

struct Batches {
  EnvConfig config;
  std::shared_ptr<const EpisodeSet> set = std::make_shared<const EpisodeSet>(load_episode_set(source_dir() / "tests/pinned/episodes.json"));

  Batches() {
    ConfigReader reader = ConfigReader::from_file(source_dir() / "tests/pinned/batch.yaml");
    read(reader, config);
    reader.finish();
    validate(config);
  }
  [[nodiscard]] std::unique_ptr<BatchedEnv> make(int threads) const {
    EnvConfig env_config = config;
    env_config.threads = threads;
    return std::make_unique<BatchedEnv>(env_config, set, make_scene_cache(env_config), kEnvs);
  }
};

/// Of every sensor, reward and flag over all steps.  restored: half way the state goes on in another batch, with another number of threads.
pinned::BitHash bits_of_steps(const Batches& batches, int threads, bool restored) {
  std::unique_ptr<BatchedEnv> env = batches.make(threads);
  env->reset();
  pinned::BitHash bits;
  std::vector<std::int32_t> actions(kEnvs);
  for (int step = 0; step < kSteps; ++step) {
    if (restored && step == kSteps / 2) {
      const std::string state = env->save_state();
      env = batches.make(9 - threads);
      env->restore(state);
    }
    for (int e = 0; e < kEnvs; ++e) actions[static_cast<std::size_t>(e)] = 1 + (step * 3 + e * 5) % 7 % 3;
    env->step(actions);
    for (const SensorSpec& sensor : env->sensors()) bits.add(env->rows(sensor.name));
    bits.add(env->rewards()).add(std::as_bytes(env->terminated())).add(std::as_bytes(env->truncated()));
  }
  return bits;
}

TEST(PinnedBits, TwoHundredStepsOnAnyNumberOfThreadsFreshAndRestored) {
  const Batches batches;
  const pinned::BitHash first = bits_of_steps(batches, 1, false);
  for (const int threads : {1, 2, 4, 8})
    for (const bool restored : {false, true})
      EXPECT_EQ(bits_of_steps(batches, threads, restored).hex(), first.hex()) << threads << " threads, restored " << restored;
  if (kSteps == 200) pinned::expect_pinned_rays("batch_200_steps", first, {pinned::transforms()});
}

}  // namespace
}  // namespace earshot
