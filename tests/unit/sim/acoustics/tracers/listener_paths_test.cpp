// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/tracers/listener_paths.h"

#include <gtest/gtest.h>

#include <cstring>
#include <string>
#include <vector>

#include "sim/acoustics/response/energy_response.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

using Use = ListenerPaths::Use;

bool same_bits(const EnergyHistogram& a, const EnergyHistogram& b) {
  return a.values().size() == b.values().size() && a.dropped_energy() == b.dropped_energy() &&
         std::memcmp(a.values().data(), b.values().data(), a.values().size_bytes()) == 0;
}

bool same(const TraceStats& a, const TraceStats& b) {
  return a.rays == b.rays && a.ray_hits == b.ray_hits && a.ray_escapes == b.ray_escapes && a.shadow_rays == b.shadow_rays &&
         a.nonfinite_dropped == b.nonfinite_dropped;
}

/// Late fields of sources that move about a box, with one response that keeps the listener's rays and with a new one each time.
void expect_bits_of_a_new_trace(const AcousticScene& scene, glm::vec3 listener, const std::vector<glm::vec3>& sources) {
  EnergyResponse kept;
  for (int round = 0; round < 2; ++round) {
    for (std::size_t i = 0; i < sources.size(); ++i) {
      const EarlyCandidates candidates(scene, SoundSource{sources[round == 0 ? i : sources.size() - 1 - i]});
      compute_energy_response(scene, candidates, listener, kept);
      EnergyResponse fresh;
      compute_energy_response(scene, candidates, listener, fresh);
      EXPECT_TRUE(same_bits(kept.late, fresh.late)) << "source " << i << ", round " << round;
      EXPECT_TRUE(same(kept.stats, fresh.stats)) << "source " << i << ", round " << round;
      EXPECT_GT(fresh.late.energy(fresh.late.num_bins() / 4, 0), 0.f);
      ASSERT_EQ(kept.arrivals.size(), fresh.arrivals.size());
      for (std::size_t a = 0; a < fresh.arrivals.size(); ++a) EXPECT_EQ(kept.arrivals[a].amplitude, fresh.arrivals[a].amplitude);
    }
  }
}

std::vector<glm::vec3> walk(glm::vec3 from, glm::vec3 step) {
  std::vector<glm::vec3> points;
  for (int i = 0; i < 6; ++i) points.push_back(from + static_cast<float>(i) * step);
  return points;
}

TEST(ListenerPaths, MovingSourceHasTheBitsOfANewTrace) {
  AcousticConfig config;
  for (const int rays : {64, 256}) {
    config.rays = rays;
    const AcousticScene scene(rooms::shoe1(0.2, 0.3), config);
    expect_bits_of_a_new_trace(scene, rooms::shoe1_listener(), walk(rooms::shoe1_source(), {0.07f, 0.02f, -0.05f}));
  }
}

// Walls that let sound through, with few and many bands.
TEST(ListenerPaths, ThroughWallsToo) {
  for (const int bands : {0, 20}) {
    AcousticConfig config;
    config.transmission = Switch::on;
    config.bands = bands;
    TriangleMesh mesh;
    rooms::append_box(mesh, {0, 0, 0}, {6, 4, 3}, 0);
    rooms::append_quad(mesh, {rooms::point(3, 0, 0), rooms::point(3, 3.2, 0), rooms::point(3, 3.2, 3), rooms::point(3, 0, 3)}, 1);
    const AcousticScene scene(
        rooms::scene_of(std::move(mesh), {Material::uniform("wall", 0.2f, 0.3f), Material::uniform("sheet", 0.5f, 0.2f, 0.05f)}), config);
    expect_bits_of_a_new_trace(scene, rooms::point(5, 1.3, 1.6), walk(rooms::point(0.7, 1, 1.2), {0.9f, 0.01f, 0.02f}));
  }
}

// Mirrors that face each other: rows of images are left out of the trace by the planes of each path, and which rows there are depends on
// the source.
TEST(ListenerPaths, FlutterToo) {
  AcousticConfig config;
  std::array<Material, 6> walls = rooms::uniform_walls(0.6, 0.5);
  walls[0] = walls[1] = Material::uniform("mirror", 0.02f, 0.02f);
  const AcousticScene scene(rooms::box(5, 4, 3, walls), config);
  const auto sources = walk(rooms::shoe1_source(), {0.11f, 0.02f, -0.05f});
  EXPECT_TRUE(EarlyCandidates(scene, SoundSource{sources[0]}).long_chains());
  expect_bits_of_a_new_trace(scene, rooms::shoe1_listener(), sources);
}

// A house, so that segments are hidden by what hid the one before, and sources with a size and a pattern.
TEST(ListenerPaths, InAHouseWithSourcesOfASize) {
  const AcousticScene scene(std::make_shared<const Scene>(load_scene("house:4,rooms=3,area_m2=40")), AcousticConfig{});
  const glm::vec3 lower = scene.scene().bounds().lower, size = scene.scene().bounds().upper - lower;
  const glm::vec3 listener = lower + glm::vec3(0.3f, 0.6f, 0.35f) * size, from = lower + glm::vec3(0.2f, 0.55f, 0.3f) * size;
  EnergyResponse kept;
  for (int i = 0; i < 8; ++i) {
    SoundSource source{from + 0.3f * static_cast<float>(i) * glm::vec3(0.6f, 0, 0.8f)};
    source.radius_m = i % 3 == 2 ? 0.1f : 0.f;
    const EarlyCandidates candidates(scene, source);
    compute_energy_response(scene, candidates, listener, kept);
    EnergyResponse fresh;
    compute_energy_response(scene, candidates, listener, fresh);
    EXPECT_TRUE(same_bits(kept.late, fresh.late)) << i;
    EXPECT_TRUE(same(kept.stats, fresh.stats)) << i;
  }
}

TEST(ListenerPaths, RecordsTheSecondTimeAndForgetsWhenAnythingMoves) {
  ListenerPaths paths;
  EXPECT_EQ(paths.next(0, {0, 0, 0}), Use::none);  // whatever it begins with
  EXPECT_EQ(paths.next(1, {1, 2, 3}), Use::none);
  EXPECT_EQ(paths.next(1, {1, 2, 3}), Use::record);
  EXPECT_EQ(paths.next(1, {1, 2, 3}), Use::replay);
  EXPECT_EQ(paths.next(2, {1, 2, 3}), Use::none);
  EXPECT_EQ(paths.next(1, {1, 2, 3}), Use::none);
  EXPECT_EQ(paths.next(1, {1, 2, 3.5f}), Use::none);
  EXPECT_EQ(paths.next(1, {1, 2, 3.5f}), Use::record);
  const std::array<float, 8> reflected{};
  for (std::size_t i = 0; i <= ListenerPaths::kMaxVertices; ++i) paths.add({}, reflected);
  EXPECT_TRUE(paths.vertices().empty());
  EXPECT_EQ(paths.next(1, {1, 2, 3.5f}), Use::none);
}

TEST(ListenerPaths, SourcesShareAListenerAndCopiesDoNot) {
  EnergyResponse first, second;
  second.memory.use_memory_of(first.memory);
  EXPECT_EQ(&second.memory.paths(), &first.memory.paths());
  EnergyResponse copy = second;
  EXPECT_NE(&copy.memory.paths(), &first.memory.paths());
  copy = first;
  EXPECT_NE(&copy.memory.paths(), &first.memory.paths());
}

}  // namespace
}  // namespace earshot
