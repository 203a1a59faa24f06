// SPDX-License-Identifier: Apache-2.0
#pragma once

/// @file
/// The walkable floor of a scene: places, distances, paths.

#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "earshot/scene.h"

namespace earshot::api {

/// The cylinder that walks.
struct NavigationOptions {
  double agent_radius_m = 0.1, agent_height_m = 1.5;
  double max_climb_m = 0.2, max_slope_deg = 45;
};

/// End of a move.
struct MoveResult {
  Vec3 position;
  bool collided = false;  ///< an obstacle stopped or deflected the move
};

/// Walkable surface of a scene: places, distances, paths.  Points are foot points on the floor.  Copies share the surface.  Safe from any
/// thread.
///
/// Cost: 13 ms to build for a house of 36 m2, 0.2 s for 146,000 triangles; a distance takes microseconds to a millisecond.
class Navigation {
 public:
  /// @throws InputError for an option out of range, or if nothing is walkable.
  explicit Navigation(const Scene& scene, const NavigationOptions& options = {});

  [[nodiscard]] double area_m2() const;  ///< of the largest connected floor
  [[nodiscard]] int num_islands() const;
  /// Nearest walkable point within `reach_m` horizontally and 1 m vertically.
  [[nodiscard]] std::optional<Vec3> snap(const Vec3& point, double reach_m = 0.5) const;
  /// Point number `index` of a sequence, uniform over the largest connected floor; a function of (scene, seed, index).
  [[nodiscard]] Vec3 random_point(std::uint64_t seed, std::uint32_t index = 0) const;
  /// Length of the shortest walkable path; nothing if there is none.
  [[nodiscard]] std::optional<double> distance_m(const Vec3& from, const Vec3& to) const;
  /// Corners of the shortest path, `from` and `to` included; empty if there is none.
  [[nodiscard]] std::vector<Vec3> path(const Vec3& from, const Vec3& to) const;
  /// Moves horizontally by `displacement`, sliding along obstacles.
  /// @throws InputError if `from` is not on the walkable surface.
  [[nodiscard]] MoveResult move(const Vec3& from, const Vec3& displacement) const;

  struct Model;
  explicit Navigation(std::shared_ptr<const Model> model) : model_(std::move(model)) {}  ///< for the library

 private:
  std::shared_ptr<const Model> model_;
};

}  // namespace earshot::api
