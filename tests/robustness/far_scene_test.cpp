// SPDX-License-Identifier: Apache-2.0
// Scenes far from the origin of their files are computed near it (docs/evidence/stability.md, H-9).

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>

#include "sim/acoustics/response/energy_response.h"
#include "sim/base/errors.h"
#include "tests/support/envs/env_fixture.h"
#include "tests/support/files/mesh_cases.h"

namespace earshot {
namespace {

using namespace mesh_cases;
using testing::HasSubstr;

const std::array<double, 4> kOffsets = {1e3, 1e4, 1e5, 1e6};
const glm::dvec3 kSize(5, 3, 4), kSource(1.2, 1.1, 1.5), kListener(3.8, 1.6, 2.3);

TEST(H9_FarFromTheOrigin, EveryFormatThatHoldsTheDigitsKeepsThem) {
  const DoubleMesh near = box(kSize);
  const std::uint64_t expected = hash_of(import("room.obj", obj_text(near)).mesh);
  for (const double offset : kOffsets) {
    const glm::dvec3 at(offset, 0, -offset);
    const DoubleMesh far = box(kSize, at);
    const std::vector<std::pair<std::string, std::string>> files{{"room.obj", obj_text(far)},
                                                                 {"text.ply", ply_file(far, PlyBody::text)},
                                                                 {"double.ply", ply_file(far, PlyBody::doubles)},
                                                                 {"big_endian.ply", ply_file(far, PlyBody::doubles_big_endian)},
                                                                 {"room.stl", stl_text(far)},
                                                                 {"room.gltf", gltf_file(near, at)}};
    for (const auto& [name, bytes] : files) {
      const ImportedMesh imported = import(name, bytes);
      EXPECT_EQ(imported.mesh.origin_m, at) << name << " at " << offset;
      EXPECT_TRUE(imported.report.warnings.empty()) << name << " at " << offset << ": " << imported.report.warnings.front();
      const Bounds bounds = bounds_of(imported.mesh);
      EXPECT_EQ(bounds.lower, glm::vec3(0)) << name;
      EXPECT_EQ(bounds.upper, glm::vec3(kSize)) << name;
      if (name == "room.obj") {
        EXPECT_EQ(hash_of(imported.mesh), expected) << "a shift by whole metres keeps every bit";
      }
    }
  }
}

// Offsets and sizes that no float holds: what is left is the rounding of a float near zero.
TEST(H9_FarFromTheOrigin, OddCoordinatesAreExactToAFloatNearZero) {
  const glm::dvec3 at(1e6 + 0.123456789, -3e5 - 0.7654321, 0.25);
  const DoubleMesh far = box({5.013, 3.007, 4.019}, at);
  for (const auto& [name, bytes] : {std::pair{"a.obj", obj_text(far)},
                                    {"a.ply", ply_file(far, PlyBody::text)},
                                    {"b.ply", ply_file(far, PlyBody::doubles)},
                                    {"a.stl", stl_text(far)},
                                    {"a.gltf", gltf_file(box({5.013, 3.007, 4.019}), at)}}) {
    const TriangleMesh mesh = import(name, bytes).mesh;
    ASSERT_EQ(mesh.vertices.size(), 8u) << name;
    EXPECT_EQ(mesh.origin_m, glm::dvec3(1e6, -300001, 0)) << name << ": whole metres, and only where it is far";
    for (const glm::vec3 vertex : mesh.vertices) {
      double nearest_m = 1;
      for (const glm::dvec3 given : far.vertices) nearest_m = std::min(nearest_m, glm::length(glm::dvec3(vertex) + mesh.origin_m - given));
      EXPECT_LT(nearest_m, 1e-6) << name << ": two roundings of coordinates below 8 m (4.8e-7 each)";
    }
  }
}

// The rest hold floats: differences below their precision are lost before reading, and the report states the loss.
TEST(H9_FarFromTheOrigin, FilesOfFloatsSayHowCoarseTheyAre) {
  const DoubleMesh far = box({5.3, 3.3, 4.3}, glm::dvec3(1e6, 0, 0));
  for (const auto& [name, bytes] :
       {std::pair{"a.stl", stl_binary(far)}, {"a.ply", ply_file(far, PlyBody::floats)}, {"a.gltf", gltf_file(far)}}) {
    const ImportedMesh imported = import(name, bytes);
    EXPECT_EQ(imported.mesh.origin_m, glm::dvec3(1e6, 0, 0)) << name;
    ASSERT_EQ(imported.report.warnings.size(), 1u) << name;
    EXPECT_THAT(imported.report.warnings[0], HasSubstr("exact to 0.062 m only")) << name << ": 2^-4 m between 2^19 and 2^20 m";
    // 5.3 m comes out as a multiple of 1/16 m: 5.3125.
    EXPECT_EQ(bounds_of(imported.mesh).upper.x, 5.3125f) << name;
  }
}

TEST(H9_FarFromTheOrigin, ScenesNearTheOriginStayWhereTheyAre) {
  for (const glm::dvec3 at : {glm::dvec3(0), glm::dvec3(-2, 0, -2), glm::dvec3(30, 0, -30)}) {
    const ImportedMesh imported = import("room.obj", obj_text(box(kSize, at)));
    EXPECT_EQ(imported.mesh.origin_m, glm::dvec3(0));
    EXPECT_EQ(bounds_of(imported.mesh).lower, glm::vec3(at));
    EXPECT_TRUE(imported.report.warnings.empty());
  }
  EXPECT_EQ(import("chair.obj", obj_text(box({0.25, 0.25, 0.25}, {10.5, 0, 0}))).mesh.origin_m, glm::dvec3(10.5, 0, 0))
      << "small things sooner, in steps of their own size";
}

TEST(H9_FarFromTheOrigin, OriginTakesUnitAndAxesFromTheirReader) {
  // Centimetres with z up: (x, y, z) cm -> (x, z, -y) / 100 m.  In float, 0.01 is off by 2e-8: 2 cm at this distance.
  const DoubleMesh far = box({500, 400, 300}, {1e8, 2e8, 0});
  const ImportedMesh imported = import("room.obj", obj_text(far), {MeshImportOptions::Up::z, 0.01});
  EXPECT_EQ(imported.mesh.origin_m, glm::dvec3(1e6, 0, -2000004));
  EXPECT_EQ(bounds_of(imported.mesh).lower, glm::vec3(0));
  EXPECT_EQ(bounds_of(imported.mesh).upper, glm::vec3(5, 3, 4));
}

TEST(H9_FarFromTheOrigin, CeilingAndSimplificationFollow) {
  const TempFolder folder;
  folder.write("room.obj", obj_text(box(kSize, {1e5, 2000, -1e5})));
  const Scene scene = load_scene(folder.write("room.yaml", "mesh: room.obj\nceiling_m: 2003.5\nsimplify_m: 0.01\n"));
  EXPECT_EQ(scene.origin_m(), glm::dvec3(1e5, 2000, -1e5));
  EXPECT_EQ(scene.bounds().upper, glm::vec3(5, 3.5f, 4));
  EXPECT_EQ(scene.to_local({1e5 + 1.25, 2001.5, -1e5 + 2}), glm::vec3(1.25f, 1.5f, 2));
  EXPECT_EQ(scene.to_world({1.25f, 1.5f, 2}), glm::dvec3(1e5 + 1.25, 2001.5, -1e5 + 2));
  EXPECT_THAT(message_of<InputError>([&] { load_scene(folder.write("low.yaml", "mesh: room.obj\nceiling_m: 1999\n")); }),
              HasSubstr("lowest point of the mesh, 2000 m"));
}

EnergyResponse respond(const std::string& file, glm::dvec3 at) {
  AcousticConfig config;
  config.rays = 2000;
  config.bands = 2;
  config.rir_length_s = 0.3f;
  const AcousticScene scene(std::make_shared<const Scene>(load_scene(file)), config);
  const EarlyCandidates candidates(scene, scene.scene().to_local(at + kSource));
  EnergyResponse response;
  compute_energy_response(scene, candidates, scene.scene().to_local(at + kListener), response);
  return response;
}

void expect_equal(const EnergyResponse& far, const EnergyResponse& near, double late_tolerance, const std::string& which) {
  constexpr double tolerance = 1e-6;
  ASSERT_EQ(far.arrivals.size(), near.arrivals.size()) << which;
  ASSERT_GT(near.arrivals.size(), 20u) << "direct, and images up to the second order";
  for (std::size_t i = 0; i < near.arrivals.size(); ++i) {
    EXPECT_NEAR(far.arrivals[i].distance_m / near.arrivals[i].distance_m, 1, tolerance) << which;
    for (std::size_t band = 0; band < 2; ++band)
      EXPECT_NEAR(far.arrivals[i].amplitude[band], near.arrivals[i].amplitude[band], tolerance * near.arrivals[i].amplitude[band]) << which;
  }
  ASSERT_EQ(far.late.num_bins(), near.late.num_bins());
  for (int band = 0; band < 2; ++band) {
    const std::vector<double> a = far.late.band_energy(band), b = near.late.band_energy(band);
    double total = 0, largest_difference = 0;
    for (std::size_t i = 0; i < a.size(); ++i) {
      total += b[i];
      largest_difference = std::max(largest_difference, std::fabs(a[i] - b[i]));
    }
    ASSERT_GT(total, 0);
    EXPECT_LE(largest_difference / total, late_tolerance) << which << ", band " << band;
  }
}

// docs/evidence/stability.md, H-9: equal to the results at the origin to 1e-6.  Offsets in whole metres give the same bits.
TEST(H9_FarFromTheOrigin, ResultsAreThoseAtTheOrigin) {
  const TempFolder folder;
  const EnergyResponse near = respond(folder.write("near.obj", obj_text(box(kSize))), glm::dvec3(0));
  for (const double offset : kOffsets) {
    const glm::dvec3 at(offset, offset, offset);
    const EnergyResponse far = respond(folder.write(fmt::format("far_{}.obj", offset), obj_text(box(kSize, at))), at);
    // The points are given as decimals: offset + 1.2 in double is 1.2 to 1e-10 only, which may round to another float.
    expect_equal(far, near, 1e-6, fmt::format("{} m", offset));
  }
}

// An offset that is not a whole number shifts the room inside its first metre, so every coordinate rounds differently.  Arrivals keep to
// 1e-6.
// Of 2,000 traced rays with their tens of bounces one or two meet the other wall at an edge: 3e-5 of the energy, far below their noise of 2
// %.
TEST(H9_FarFromTheOrigin, ResultsAtOddOffsetsDifferByRoundingOnly) {
  const TempFolder folder;
  const EnergyResponse near = respond(folder.write("near.obj", obj_text(box(kSize))), glm::dvec3(0));
  const glm::dvec3 at(1e6 / 3, -2e5 / 7, 1e6 / 9);
  const EnergyResponse far = respond(folder.write("far.obj", obj_text(box(kSize, at))), at);
  expect_equal(far, near, 2e-4, "odd");
}

TEST(H9_FarFromTheOrigin, EnvironmentsStepAsAtTheOrigin) {
  const TempFolder folder;
  const glm::dvec3 at(1e6, 0, -1e5);
  folder.write("near/room.obj", obj_text(box({6, 3, 5})));
  folder.write("far/room.obj", obj_text(box({6, 3, 5}, at)));
  const auto run = [&](const std::string& root, glm::dvec3 shift) {
    EnvConfig config = quick_env_config();
    config.scene_root = folder / root;
    Episode episode = room_episode("room.obj", glm::vec3(0), 0.5, glm::vec3(0), "synth:noise");
    episode.start_position = shift + glm::dvec3(1.25, 0, 1.5);
    episode.goal_position = shift + glm::dvec3(4.5, 0, 3.25);
    save_episode_set(*make_set({episode}), folder / (root + ".json"));
    const auto set = std::make_shared<const EpisodeSet>(load_episode_set(folder / (root + ".json")));  // through the text
    BatchedEnv env(config, set, make_scene_cache(config), 1);
    env.reset();
    std::vector<float> seen;
    const std::int32_t actions[] = {1, 2, 1, 1, 3, 1, 1, 2, 1, 1};
    for (const std::int32_t action : actions) {
      env.step(std::span(&action, 1));
      for (const auto row : {float_rows(env, "depth"), float_rows(env, "waveform"), float_rows(env, "pointgoal"), env.rewards()})
        seen.insert(seen.end(), row.begin(), row.end());
    }
    return seen;
  };
  EXPECT_EQ(run("far", at), run("near", glm::dvec3(0))) << "bit for bit";
}

}  // namespace
}  // namespace earshot
