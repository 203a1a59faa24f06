// SPDX-License-Identifier: Apache-2.0
// Question: pictures per second and core of the two renderers, depth alone and with all sensors?  (docs/evidence/cameras.md)
// EARSHOT_EGL_DEVICE names the device (EglOptions::device; default: software).

#include <benchmark/benchmark.h>

#include <array>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include "sim/nav/navmesh.h"
#include "sim/vision/egl_renderer.h"
#include "sim/vision/embree_camera.h"

namespace earshot {
namespace {

constexpr std::array<const char*, 4> kScenes{"shoebox:6x3x4", "house:7", "house:7,detail_m=0.12", "floor:1,detail_m=0.12"};
constexpr CameraSensorConfig kCamera{.width_px = 128, .height_px = 128};
constexpr std::size_t kPixels = 128 * 128, kViews = 32;
enum Sensors { depth_alone, all };

/// Views of a scene from random places that an agent can stand on, with room for their pictures.
struct Batch {
  std::shared_ptr<const Scene> scene;
  std::shared_ptr<const Appearance> appearance;
  std::vector<float> depth = std::vector<float>(kViews * kPixels), normals = std::vector<float>(3 * kViews * kPixels);
  std::vector<std::uint8_t> rgb = std::vector<std::uint8_t>(3 * kViews * kPixels);
  std::vector<std::uint16_t> semantic = std::vector<std::uint16_t>(kViews * kPixels);
  std::vector<EglView> views;

  Batch(const std::string& spec, Sensors sensors)
      : scene(std::make_shared<const Scene>(load_scene(spec))), appearance(load_appearance(*scene)) {
    const Navmesh navmesh(scene->mesh(), {});
    const RandomStream random(1, Purpose::bench);
    for (std::uint32_t i = 0; i < kViews; ++i) {
      CameraImages images{.depth = std::span(depth).subspan(i * kPixels, kPixels)};
      if (sensors == all) {
        images.rgb = std::span(rgb).subspan(3 * i * kPixels, 3 * kPixels);
        images.semantic = std::span(semantic).subspan(i * kPixels, kPixels);
        images.normals = std::span(normals).subspan(3 * i * kPixels, 3 * kPixels);
      }
      views.push_back(
          {scene, appearance, {.position = navmesh.random_point(random, 3 * i), .heading_rad = 6.28 * random.uniform(3 * i + 2)}, images});
    }
  }
};

void report(benchmark::State& state, const Batch& batch) {
  state.SetLabel(kScenes[static_cast<std::size_t>(state.range(0))]);
  state.counters["triangles"] = static_cast<double>(batch.scene->mesh().triangles.size());
  state.counters["pictures_per_core_s"] = benchmark::Counter(static_cast<double>(state.iterations()) * kViews, benchmark::Counter::kIsRate);
}

void BM_Embree(benchmark::State& state) {
  const Batch batch(kScenes[static_cast<std::size_t>(state.range(0))], static_cast<Sensors>(state.range(1)));
  const EmbreeCamera camera(kCamera);
  for (auto _ : state)
    for (const EglView& view : batch.views) camera.render(*view.scene, view.appearance.get(), view.pose, view.images);
  report(state, batch);
}

void BM_Egl(benchmark::State& state) {
  const Batch batch(kScenes[static_cast<std::size_t>(state.range(0))], static_cast<Sensors>(state.range(1)));
  const char* device = std::getenv("EARSHOT_EGL_DEVICE");
  EglRenderer renderer({.device = device ? device : "software"});
  for (auto _ : state) renderer.render(kCamera, batch.views);
  report(state, batch);
}

BENCHMARK(BM_Embree)
    ->ArgNames({"scene", "all"})
    ->ArgsProduct({{0, 1, 2, 3}, {depth_alone, all}})
    ->MeasureProcessCPUTime()
    ->Repetitions(5)
    ->ReportAggregatesOnly();
BENCHMARK(BM_Egl)
    ->ArgNames({"scene", "all"})
    ->ArgsProduct({{0, 1, 2, 3}, {depth_alone, all}})
    ->MeasureProcessCPUTime()
    ->Repetitions(5)
    ->ReportAggregatesOnly();

}  // namespace
}  // namespace earshot
