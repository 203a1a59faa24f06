// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <atomic>
#include <cstdlib>
#include <new>

#include "sim/acoustics/response/energy_response.h"
#include "tests/support/acoustics/rooms.h"

// A sanitizer brings its own operator new: allocations are counted in the other builds.
#ifndef EARSHOT_SANITIZED

// Counts every allocation of this test program through operator new.
namespace {
std::atomic<long> allocations{0};
void* counted(std::size_t size, std::size_t alignment) {
  ++allocations;
  const std::size_t rounded = (size + alignment - 1) / alignment * alignment;
  void* memory = std::aligned_alloc(alignment, rounded == 0 ? alignment : rounded);
  if (!memory) throw std::bad_alloc();
  return memory;
}
}  // namespace

void* operator new(std::size_t size) { return counted(size, alignof(std::max_align_t)); }
void* operator new(std::size_t size, std::align_val_t alignment) { return counted(size, static_cast<std::size_t>(alignment)); }
// The pairs match each other; g++ 12 compares them with the operators that they replace.
#pragma GCC diagnostic ignored "-Wmismatched-new-delete"
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
void operator delete(void* memory, std::align_val_t) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t, std::align_val_t) noexcept { std::free(memory); }

namespace earshot {
namespace {

/// Allocations of ten more responses once three have been computed.  `response` holds the last.
long allocations_once_warm(const AcousticScene& scene, glm::vec3 source, glm::vec3 listener, EnergyResponse& response) {
  const EarlyCandidates candidates(scene, source);
  for (int i = 0; i < 3; ++i) compute_energy_response(scene, candidates, listener, response);
  const long before = allocations;
  for (int i = 0; i < 10; ++i) compute_energy_response(scene, candidates, listener, response);
  return allocations - before;
}

TEST(EnergyResponse, AllocatesNothingOnceWarm) {
  EnergyResponse response;
  const AcousticScene scene(rooms::shoe1(0.2, 0.3), AcousticConfig{});
  EXPECT_EQ(allocations_once_warm(scene, rooms::shoe1_source(), rooms::shoe1_listener(), response), 0);
}

TEST(EnergyResponse, AllocatesNothingWithWallsThatLetSoundThrough) {
  AcousticConfig config;
  config.transmission = Switch::on;
  std::array<Material, 6> leaky;
  leaky.fill(Material::uniform("leaky", 0.3f, 0.3f, 0.1f));
  EnergyResponse response;
  const AcousticScene scene(rooms::box(5, 4, 3, leaky), config);
  EXPECT_EQ(allocations_once_warm(scene, rooms::shoe1_source(), rooms::shoe1_listener(), response), 0);
}

TEST(EnergyResponse, AllocatesNothingRoundCorners) {
  TriangleMesh mesh;
  append_box(mesh, {-2, 0, -0.1f}, {2, 2, 0.1f}, 0, 0);
  EnergyResponse response;
  const AcousticScene scene(rooms::scene_of(std::move(mesh), {Material::uniform("wall", 0.2f, 0.2f)}), AcousticConfig{});
  EXPECT_EQ(allocations_once_warm(scene, {0, 1, 2}, {0.3f, 1, -2}, response), 0);
  EXPECT_EQ(response.arrivals.front().kind, ArrivalKind::diffraction);
}

}  // namespace
}  // namespace earshot

#endif
