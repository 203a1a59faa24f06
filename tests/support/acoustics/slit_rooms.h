#pragma once

#include <cmath>
#include <cstdio>
#include <memory>
#include <span>
#include <vector>

#include "tests/support/acoustics/bidirectional_field.h"
#include "tests/support/acoustics/source_field_cases.h"

/// Rooms with walls between them that are nearly closed.
namespace earshot::slits {

using rooms::append_box;
using rooms::append_quad;
using rooms::point;

/// Two rooms of 3.7 x 4 x 2.7 m on both sides of a sheet, with a doorway of 0.9 x 2.05 m in it, and a leaf.
inline constexpr double kWallX = 3.7, kWidth = 4, kHeight = 2.7, kDoor0 = 1.5, kDoor1 = 2.4, kDoorHeight = 2.05;

inline TriangleMesh rooms_with_a_doorway() {
  TriangleMesh mesh;
  append_box(mesh, {0, 0, 0}, {2 * kWallX, kWidth, kHeight}, 0);
  const auto sheet = [&](double y0, double y1, double z0, double z1) {
    append_quad(mesh, {point(kWallX, y0, z0), point(kWallX, y1, z0), point(kWallX, y1, z1), point(kWallX, y0, z1)}, 0);
  };
  sheet(0, kDoor0, 0, kHeight);
  sheet(kDoor1, kWidth, 0, kHeight);
  sheet(kDoor0, kDoor1, kDoorHeight, kHeight);
  return mesh;
}

inline std::shared_ptr<const Scene> finish(TriangleMesh mesh) {
  return rooms::scene_of(std::move(mesh), {Material::uniform("wall", 0.2f, 1.f)});
}

/// Shut, with a slit of this height under the leaf.
inline std::shared_ptr<const Scene> slit_room(double slit_m) {
  TriangleMesh mesh = rooms_with_a_doorway();
  append_quad(mesh,
              {point(kWallX, kDoor0, slit_m), point(kWallX, kDoor1, slit_m), point(kWallX, kDoor1, kDoorHeight),
               point(kWallX, kDoor0, kDoorHeight)},
              0);
  return finish(std::move(mesh));
}

/// The free edge of the leaf stands `gap_m` off the wall.
inline std::shared_ptr<const Scene> ajar_room(double gap_m) {
  TriangleMesh mesh = rooms_with_a_doorway();
  const double leaf_m = kDoor1 - kDoor0, along_m = std::sqrt(leaf_m * leaf_m - gap_m * gap_m);
  const double free_x = kWallX + gap_m, free_y = kDoor0 + along_m;
  append_quad(mesh,
              {point(kWallX, kDoor0, 0), point(free_x, free_y, 0), point(free_x, free_y, kDoorHeight), point(kWallX, kDoor0, kDoorHeight)},
              0);
  return finish(std::move(mesh));
}

/// Levels of the late field behind the wall, by the field with cells of 1 m and of 0.5 m, against paths: within 3 dB at each place.
/// rays: from either end, for a standard error below `error`; at most 0.15, which is 0.7 dB.
inline void expect_levels_of_paths(const std::shared_ptr<const Scene>& room, std::span<const glm::vec3> places, int rays, double error) {
  const SoundSource source{point(1.1, 1.2, 1.4)};
  const auto level_db = [](double energy) { return 10 * std::log10(energy); };
  AcousticConfig config = rooms::bidirectional_config(rays);
  config.rir_length_s = 1.f;
  config.source_bounces = 30;
  std::vector<double> paths_db;
  for (const glm::vec3 place : places) {
    const rooms::Sample sample = rooms::bidirectional_field(room, config, source, place).total();
    EXPECT_LT(sample.standard_error, error * sample.mean);
    paths_db.push_back(level_db(sample.mean));
  }
  for (const float cell_m : {1.f, 0.5f}) {
    const source_fields::Field field(room, source_fields::field_config(65'536, cell_m), source);
    std::printf("cells of %.1f m:", cell_m);
    for (std::size_t i = 0; i < places.size(); ++i) {
      const double field_db = level_db(rooms::total_energy(field.at(places[i])));
      std::printf(" %+.1f", field_db - paths_db[i]);
      EXPECT_NEAR(field_db, paths_db[i], 3.0) << "cells of " << cell_m << " m, place " << i;
    }
    std::printf(" dB\n");
  }
}

}  // namespace earshot::slits
