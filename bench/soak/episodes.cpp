// SPDX-License-Identifier: Apache-2.0
#include "bench/soak/episodes.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <exception>
#include <limits>
#include <map>
#include <numbers>
#include <optional>
#include <thread>

#include "envs/episodes/episode_generator.h"
#include "envs/hearing/sound_library.h"
#include "sim/base/errors.h"
#include "sim/base/process/progress.h"
#include "sim/scene/generators/house_plan.h"

namespace earshot {
namespace {

constexpr std::array<const char*, 8> kSoundKinds{"telephone", "alarm", "music", "noise", "speech", "click", "engine", "bird"};
constexpr int kSoundSeeds = 2;

std::vector<std::string> soak_sounds() {
  std::vector<std::string> sounds;
  for (const char* kind : kSoundKinds)
    for (int seed = 0; seed < kSoundSeeds; ++seed) sounds.push_back(fmt::format("synth:{}:{}", kind, seed));
  return sounds;
}

struct Rect {
  float x0, z0, x1, z1;
  [[nodiscard]] bool holds(glm::vec3 p, float margin_m) const {
    return p.x >= x0 - margin_m && p.x <= x1 + margin_m && p.z >= z0 - margin_m && p.z <= z1 + margin_m;
  }
};

/// Floors of the rooms of a house, or of the whole scene.
struct Rooms {
  std::vector<Rect> floors = {};
  double height_m = 0;
};

Rooms rooms_of(const SoakScene& scene, const EnvScene& loaded) {
  const Bounds& bounds = loaded.scene->bounds();
  Rooms rooms{.height_m = static_cast<double>(bounds.upper.y) - static_cast<double>(bounds.lower.y)};
  if (!scene.house.empty()) {
    const HousePlan plan = make_house_plan(resolve_house(parse_house(scene.house)));
    rooms.height_m = 1e-3 * plan.height_mm;
    int x0 = std::numeric_limits<int>::max(), z0 = x0;
    for (const PlanRoom& room : plan.rooms) x0 = std::min(x0, room.floor.x0), z0 = std::min(z0, room.floor.z0);
    // The walls stand on the edges of the floors, wherever the house was moved to.
    const auto x_m = [&](int mm) { return bounds.lower.x + 1e-3f * static_cast<float>(mm - x0); };
    const auto z_m = [&](int mm) { return bounds.lower.z + 1e-3f * static_cast<float>(mm - z0); };
    for (const PlanRoom& room : plan.rooms)
      rooms.floors.push_back({x_m(room.floor.x0), z_m(room.floor.z0), x_m(room.floor.x1), z_m(room.floor.z1)});
  } else {
    rooms.floors.push_back({bounds.lower.x, bounds.lower.z, bounds.upper.x, bounds.upper.z});
  }
  return rooms;
}

double room_energy(const Rect& floor, double height_m, const EnvScene& loaded) {
  constexpr float kMarginM = 0.01f;  // walls lie on the edge of the floor
  const Scene& scene = *loaded.scene;
  const TriangleMesh& mesh = scene.mesh();
  std::vector<double> absorption_m2(static_cast<std::size_t>(loaded.acoustics.num_bands()), 0.0);
  for (std::uint32_t i = 0; i < mesh.triangles.size(); ++i) {
    const glm::uvec3 t = mesh.triangles[i];
    if (!floor.holds((mesh.vertices[t.x] + mesh.vertices[t.y] + mesh.vertices[t.z]) / 3.f, kMarginM)) continue;
    const std::span<const float> reflectance = loaded.acoustics.reflectance(mesh.triangle_material[i]);
    for (std::size_t band = 0; band < absorption_m2.size(); ++band)
      absorption_m2[band] += static_cast<double>(scene.triangle_area_m2(i)) * (1.0 - static_cast<double>(reflectance[band]));
  }
  const double volume_m3 = static_cast<double>(floor.x1 - floor.x0) * static_cast<double>(floor.z1 - floor.z0) * height_m;
  return diffuse_field_energy(volume_m3, *std::ranges::min_element(absorption_m2),
                              static_cast<double>(loaded.acoustics.config().rir_length_s),
                              static_cast<double>(loaded.acoustics.speed_of_sound_m_per_s()));
}

/// Short walks count too: there the sound is loudest.  A cupboard has no others.
EpisodeFilter filter_of(SoakKind kind) {
  EpisodeFilter filter;
  filter.min_geodesic_m = kind == SoakKind::tiny ? 0.05f : 1.f;
  filter.max_geodesic_m = 30.f;
  filter.min_ratio = 0.f;
  return filter;
}

struct MadeInScene {
  std::vector<Episode> episodes;
  std::string refused;
  std::exception_ptr failed;  ///< anything but a refusal
};

MadeInScene make_in_scene(const SoakScene& scene, int per_scene, const EnvConfig& config, SceneCache& cache, std::uint64_t seed) {
  MadeInScene made;
  try {
    const auto loaded = cache.scene(scene.spec);
    made.episodes = generate_episodes(
        scene.spec, *loaded->scene, loaded->navmesh,
        {.task = config.task, .filter = filter_of(scene.kind), .sounds = soak_sounds(), .count = per_scene, .seed = seed});
  } catch (const InputError& error) {
    made.refused = error.what();
  } catch (...) {
    made.failed = std::current_exception();  // no exception leaves a worker thread
  }
  return made;
}

}  // namespace

double diffuse_field_energy(double volume_m3, double absorption_area_m2, double rir_length_s, double speed_m_per_s) {
  const double rigid = speed_m_per_s * rir_length_s / (4 * std::numbers::pi * volume_m3);
  return std::min(rigid, 1 / (std::numbers::pi * absorption_area_m2));  // infinite without absorption
}

double diffuse_field_energy(const SoakScene& scene, const EnvScene& loaded, glm::vec3 source) {
  const Rooms rooms = rooms_of(scene, loaded);
  for (const Rect& floor : rooms.floors)
    if (floor.holds(source, 0)) return room_energy(floor, rooms.height_m, loaded);
  double loudest = 0;
  for (const Rect& floor : rooms.floors) loudest = std::max(loudest, room_energy(floor, rooms.height_m, loaded));
  return loudest;
}

double largest_mean_square(std::span<const float> loop, std::size_t window) {
  if (loop.empty() || window == 0) return 0;
  const auto square = [&](std::size_t i) {
    return static_cast<double>(loop[i % loop.size()]) * static_cast<double>(loop[i % loop.size()]);
  };
  std::vector<double> sum_to(loop.size() + window + 1, 0.0);
  for (std::size_t i = 0; i + 1 < sum_to.size(); ++i) sum_to[i + 1] = sum_to[i] + square(i);
  double largest = 0;
  for (std::size_t i = 0; i < loop.size(); ++i) largest = std::max(largest, sum_to[i + window] - sum_to[i]);
  return largest / static_cast<double>(window);
}

SoakEpisodes make_soak_episodes(const std::vector<SoakScene>& scenes, int per_scene, const EnvConfig& config, SceneCache& cache,
                                int threads, std::uint64_t seed) {
  std::vector<MadeInScene> made(scenes.size());
  {
    Progress progress("episodes", "scenes", scenes.size());
    std::atomic<std::size_t> next{0};
    const auto work = [&](bool shows) {
      for (std::size_t i = next++; i < scenes.size(); i = next++) {
        made[i] = make_in_scene(scenes[i], per_scene, config, cache, seed);
        if (shows) progress.update(std::min(next.load(), scenes.size()));
      }
    };
    std::vector<std::jthread> helpers;
    for (int thread = 1; thread < threads; ++thread) helpers.emplace_back(work, false);
    work(true);
  }
  SoakEpisodes result;
  for (std::size_t i = 0; i < scenes.size(); ++i) {
    if (made[i].failed) std::rethrow_exception(made[i].failed);
    if (!made[i].refused.empty()) result.refused.push_back(made[i].refused);
    for (Episode& episode : made[i].episodes) {
      result.set.episodes.push_back(std::move(episode));
      result.episodes.push_back({.scene = static_cast<std::uint32_t>(i)});
    }
  }
  if (result.set.episodes.empty()) throw InputError("--scenes", "no scene is large enough for an episode", "set more scenes");
  result.set.hash = episode_set_hash(result.set.episodes);

  const float rate_hz = config.acoustics.sample_rate_hz;
  const auto step = static_cast<std::size_t>(std::lround(rate_hz * config.task.step_time_s));
  const SoundLibrary sounds(result.set.episodes, config.sound_root, rate_hz, config.sound_gain);
  std::map<std::string, double> level;
  for (std::size_t i = 0; i < result.episodes.size(); ++i) {
    const std::string& name = result.set.episodes[i].sound;
    const auto [known, is_new] = level.try_emplace(name, 0.0);
    if (is_new) known->second = largest_mean_square(sounds.sound(name).clip.samples, step);
    result.episodes[i].dry_mean_square = known->second;
  }
  return result;
}

}  // namespace earshot
