// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <glm/geometric.hpp>
#include <memory>
#include <thread>
#include <vector>

#include "sim/acoustics/model/plane_cells.h"
#include "sim/acoustics/paths/early_reflections.h"
#include "sim/base/random.h"
#include "sim/scene/scene.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

std::shared_ptr<const Scene> house() { return std::make_shared<const Scene>(load_scene("house:4,rooms=3,area_m2=40")); }

/// Walks of eight steps of 0.15 m from points in the air.
std::vector<glm::vec3> walks(const Scene& scene, std::uint32_t count) {
  const RandomStream random(17, Purpose::test);
  const glm::vec3 lower = scene.bounds().lower, size = scene.bounds().upper - lower;
  std::vector<glm::vec3> points;
  for (std::uint32_t i = 0; i < count; ++i) {
    const auto u = random.uniform4(i);
    const glm::vec3 start = lower + size * glm::vec3(0.1f + 0.7f * u[0], 0.45f + 0.2f * u[1], 0.1f + 0.7f * u[2]);
    for (int step = 0; step < 8; ++step) points.push_back(start + 0.15f * static_cast<float>(step) * glm::vec3(0.6f, 0.f, 0.8f));
  }
  return points;
}

std::vector<Arrival> arrivals_of(const AcousticScene& scene, glm::vec3 source, glm::vec3 listener, SourceMotion motion) {
  const EarlyCandidates candidates(scene, SoundSource{source}, motion);
  std::vector<Arrival> arrivals;
  candidates.find_arrivals(scene, listener, arrivals);
  candidates.diffraction().find_arrivals(scene, listener, arrivals);
  return arrivals;
}

void expect_same_bits(const std::vector<Arrival>& a, const std::vector<Arrival>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].identity, b[i].identity);
    EXPECT_EQ(a[i].distance_m, b[i].distance_m);
    EXPECT_EQ(a[i].amplitude, b[i].amplitude);
    EXPECT_EQ(a[i].phase_rad, b[i].phase_rad);
  }
}

// What cells and edges remember of other poses changes no bit: forwards, backwards, from four threads at once, and in scenes of their own.
TEST(MovingSource, ArrivalsDoNotDependOnTheWayThere) {
  const auto scene = house();
  const AcousticScene forwards(scene, AcousticConfig{}), backwards(scene, AcousticConfig{}), threaded(scene, AcousticConfig{});
  const std::vector<glm::vec3> points = walks(*scene, 4);
  const glm::vec3 listener = points[3] + glm::vec3(0.4f, 0.1f, -0.3f);
  std::vector<std::vector<Arrival>> expected(points.size()), of_threads(points.size());
  std::size_t found = 0;
  for (std::size_t i = 0; i < points.size(); ++i)
    found += (expected[i] = arrivals_of(forwards, points[i], listener, SourceMotion::moves)).size();
  EXPECT_GT(found, points.size());
  for (std::size_t i = points.size(); i-- > 0;)
    expect_same_bits(arrivals_of(backwards, points[i], listener, SourceMotion::moves), expected[i]);
  std::vector<std::thread> threads;
  for (std::size_t t = 0; t < 4; ++t)
    threads.emplace_back([&, t] {
      for (std::size_t i = t % 2; i < points.size(); i += 2)
        if (i / 2 % 2 == t / 2) of_threads[i] = arrivals_of(threaded, points[i], listener, SourceMotion::moves);
    });
  for (std::thread& thread : threads) thread.join();
  for (std::size_t i = 0; i < points.size(); ++i) expect_same_bits(of_threads[i], expected[i]);
  for (std::size_t i = 0; i < points.size(); i += 9)
    expect_same_bits(arrivals_of(AcousticScene(scene, AcousticConfig{}), points[i], listener, SourceMotion::moves), expected[i]);
}

// A source that moves finds what a source at rest finds there: of the energy of all its images at listeners about it, 98 %; and more
// sequences.
TEST(MovingSource, FindsTheImagesOfASourceAtRest) {
  const auto scene = house();
  const AcousticScene acoustics(scene, AcousticConfig{});
  const std::vector<glm::vec3> points = walks(*scene, 12);
  double energy = 0, kept = 0;
  std::size_t at_rest = 0, moving = 0;
  for (std::size_t i = 0; i < points.size(); i += 3) {
    const EarlyCandidates rests(acoustics, SoundSource{points[i]}), moves(acoustics, SoundSource{points[i]}, SourceMotion::moves);
    at_rest += rests.size();
    moving += moves.size();
    for (const glm::vec3 way : {glm::vec3(0.7f, 0.1f, 0.2f), glm::vec3(-0.6f, -0.2f, 1.1f), glm::vec3(1.5f, 0.f, -1.7f)}) {
      std::vector<Arrival> of_rest, of_moving;
      rests.find_arrivals(acoustics, points[i] + way, of_rest);
      moves.find_arrivals(acoustics, points[i] + way, of_moving);
      for (const Arrival& image : of_rest) {
        if (image.kind != ArrivalKind::reflection) continue;
        const double image_energy = double{image.amplitude[3]} * image.amplitude[3];
        energy += image_energy;
        const bool is_found = std::ranges::any_of(of_moving, [&](const Arrival& other) { return other.identity == image.identity; });
        kept += is_found ? image_energy : 0.0;
      }
    }
  }
  EXPECT_GT(energy, 0);
  EXPECT_GT(kept, 0.98 * energy);
  EXPECT_GT(moving, at_rest);
}

// In a box all sequences are known without rays: the same candidates, and no cell.
TEST(MovingSource, InABoxNothingIsTraced) {
  const AcousticScene acoustics(rooms::shoe1(0.2, 0.3), AcousticConfig{});
  const glm::vec3 source = rooms::shoe1_source(), listener = rooms::shoe1_listener();
  expect_same_bits(arrivals_of(acoustics, source, listener, SourceMotion::moves),
                   arrivals_of(acoustics, source, listener, SourceMotion::rests));
  EXPECT_EQ(acoustics.plane_cells().size(), 0u);
}

TEST(MovingSource, CellsAreBoundedAndComeBackTheSame) {
  AcousticConfig config;
  config.early_candidate_rays = 20;
  const AcousticScene acoustics(house(), config);
  const auto first = acoustics.plane_cells().of(acoustics, {0.5f, 1.f, 0.5f});
  EXPECT_FALSE(first->empty());
  EXPECT_EQ(acoustics.plane_cells().of(acoustics, {0.51f, 1.01f, 0.49f}).get(), first.get());
  for (int i = 0; i < 700; ++i) (void)acoustics.plane_cells().of(acoustics, {0.5f + static_cast<float>(i), 1.f, 20.5f});
  EXPECT_EQ(acoustics.plane_cells().size(), PlaneCells::kMaxCells);
  const auto again = acoustics.plane_cells().of(acoustics, {0.5f, 1.f, 0.5f});
  EXPECT_NE(again.get(), first.get());
  EXPECT_EQ(*again, *first);
}

}  // namespace
}  // namespace earshot
