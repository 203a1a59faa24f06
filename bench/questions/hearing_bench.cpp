// SPDX-License-Identifier: Apache-2.0
// Question: cost of the sound of one agent per step, stage by stage, once its source field is built?
#include <benchmark/benchmark.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstring>
#include <glm/geometric.hpp>

#include "sim/acoustics/paths/early_reflections.h"
#include "sim/acoustics/paths/transmission.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "sim/audio/stream/sound_stream.h"
#include "sim/audio/transforms/spectrogram.h"
#include "sim/base/random.h"
#include "sim/nav/geodesic_field.h"
#include "sim/scene/scene.h"

namespace earshot {
namespace {

constexpr float kEarM = 1.5f;
constexpr int kBlock = 2400, kWindow = 16000;

/// A scene with a source and a walk in steps of 0.15 m from one random point to the next.
struct Walk {
  explicit Walk(const char* scene_id, float rir_length_s)
      : config(config_of(rir_length_s)),
        scene(std::make_shared<const Scene>(load_scene(scene_id))),
        acoustics(scene, config),
        navmesh(scene->mesh(), {}),
        candidates(acoustics, source()) {
    std::uint32_t draw = 1000;
    glm::vec3 at = navmesh.random_point(random, draw);
    while (poses.size() < 400) {
      const GeodesicField way(navmesh, navmesh.random_point(random, draw += 4));
      for (int step = 0; step < 60; ++step) {
        const auto corner = way.next_corner(at);
        if (!corner || glm::length(*corner - at) < 0.16f) break;
        at += 0.15f * glm::normalize(*corner - at);
        poses.push_back(at + glm::vec3(0, kEarM, 0));
      }
    }
  }
  static AcousticConfig config_of(float rir_length_s) {
    AcousticConfig config = acoustic_preset("fast");
    config.rir_length_s = rir_length_s;
    return config;
  }
  [[nodiscard]] glm::vec3 source() const { return navmesh.random_point(random, 100) + glm::vec3(0, kEarM, 0); }

  AcousticConfig config;
  RandomStream random{7, Purpose::test};
  std::shared_ptr<const Scene> scene;
  AcousticScene acoustics;
  Navmesh navmesh;
  EarlyCandidates candidates;
  std::vector<glm::vec3> poses;
};

void BM_Source(benchmark::State& state, const char* scene_id) {
  const Walk walk(scene_id, 0.6f);
  std::size_t i = 0;
  for (auto _ : state) benchmark::DoNotOptimize(EarlyCandidates(walk.acoustics, walk.poses[i++ * 37 % walk.poses.size()]));
}

/// move: every pose is new; otherwise the listener turns in place.  The late field is that of the first pose, traced once.
void BM_Hear(benchmark::State& state, const char* scene_id, bool move) {
  const Walk walk(scene_id, 0.6f);
  const auto tables = make_synthesis_tables(walk.config, walk.acoustics.bands(), ChannelLayout::binaural, nullptr);
  RirSynthesizer synthesizer(tables);
  const StreamConfig stream{.max_rir_samples = 9600};
  StreamConvolver convolver(stream, 2, std::make_shared<DrySpectra>(StreamConvolver::plan(stream, 2).fft_size, std::size_t{16} << 20));
  SpectrogramAnalyzer analyzer{SpectrogramConfig{}};
  SpectrogramHistory history;
  const SoundClip clip = synthesize_sound("synth:telephone", 16000.f);
  EnergyResponse response;
  compute_energy_response(walk.acoustics, walk.candidates, walk.poses[0], response);
  response.arrivals.reserve(walk.candidates.size() + 64);
  Rir rir;
  RirSpectra spectra, previous;
  StreamPosition position;
  std::vector<float> block(2 * kBlock), window(2 * kWindow), spectrogram(65 * 26 * 2);
  std::array<double, 6> seconds{};
  std::size_t i = 0;
  for (auto _ : state) {
    const glm::vec3 ear = walk.poses[i % walk.poses.size()];
    std::size_t stage = 0;
    const auto timed = [&](const auto& work) {
      const auto start = std::chrono::steady_clock::now();
      work();
      seconds[stage++] += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    };
    if (move || i == 0) response.arrivals.clear();
    timed([&] {
      if (move || i == 0) walk.candidates.find_arrivals(walk.acoustics, ear, response.arrivals);
    });
    timed([&] {
      if (move || i == 0) walk.candidates.diffraction().find_arrivals(walk.acoustics, ear, response.arrivals);
    });
    timed([&] {
      if (move || i == 0) find_transmitted(walk.acoustics, walk.candidates.source(), ear, response.arrivals);
    });
    timed([&] { synthesizer.render(response, 0.17 * static_cast<double>(i), 42, rir); });
    timed([&] {
      std::swap(spectra, previous);
      convolver.transform(rir.samples, rir.num_samples, spectra);
      convolver.convolve(clip, 1, position, spectra, i > 0 ? &previous : nullptr, kBlock, block);
      position.sample += kBlock;
    });
    for (std::size_t ear_index = 0; ear_index < 2; ++ear_index) {
      float* row = window.data() + ear_index * kWindow;
      std::memmove(row, row + kBlock, (kWindow - kBlock) * sizeof(float));
      std::copy_n(block.begin() + static_cast<std::ptrdiff_t>(ear_index * kBlock), kBlock, row + kWindow - kBlock);
    }
    timed([&] { analyzer.analyze(window, kBlock, history, spectrogram); });
    ++i;
  }
  state.counters["steps_per_s"] = benchmark::Counter(static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
  const std::array<const char*, 6> name = {"early_us",     "diffraction_us", "transmission_us",
                                           "synthesis_us", "convolve_us",    "spectrogram_us"};
  for (std::size_t s = 0; s < name.size(); ++s) state.counters[name[s]] = 1e6 * seconds[s] / static_cast<double>(state.iterations());
}

constexpr const char *kHouse = "house:1,rooms=9", *kReal = "configs/scenes/small_house.yaml";
BENCHMARK_CAPTURE(BM_Hear, house_moving, kHouse, true)->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(BM_Hear, house_turning, kHouse, false)->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(BM_Hear, small_house_moving, kReal, true)->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(BM_Hear, small_house_turning, kReal, false)->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(BM_Source, house, kHouse)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(BM_Source, small_house, kReal)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace earshot
