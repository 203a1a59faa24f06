// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <glm/vec3.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "sim/nav/navmesh.h"
#include "sim/scene/scene.h"

namespace earshot {

/// What the published loader takes from the name of a data set, and what its published files have.
struct GridDataset {
  double ear_height_m = 1.5;  ///< above the floor: the loader subtracts it
  double spacing_m = 1;
  double sample_rate_hz = 16000;
  /// replica: 1.5528907 m, 0.5 m and 44.1 kHz; any other name: those of mp3d.
  static GridDataset named(std::string_view name);
};

/// DATASET and SCENE in the paths of the files of a scene.
struct GridNames {
  std::string dataset, scene;
  std::string warning = {};  ///< one line for a path in scene_datasets from which DATASET cannot be told
  /// Of a SCENE: both from a path with scene_datasets/DATASET/SCENE/ in it; otherwise mp3d, and the name of the file without its ending, or
  /// the text before the first comma with '_' for what is no letter, digit, dot, dash or underscore.
  static GridNames of(const std::string& scene_spec);
};
/// Throws InputError naming the option for a name that is no part of a path, or that ends as the files which the name is given to: .zarr or
/// .pkl.
void validate(const GridNames& names);

/// Points at which sources and listeners stand.
struct GridPoints {
  std::vector<glm::vec3> ears, feet;  ///< in the coordinates of the engine
  std::size_t edges = 0, left_out = 0;
  double walkable_m2 = 0;  ///< of the island that they stand on
  /// points.txt: lines "index x y z" with tabs, of the ears, in the axes of the mesh with z up: x, -z and y of ours, to the micrometre.
  std::string points_text;
  /// edges.txt: lines "a b" with a tab, of neighbours between which the floor can be walked straight.
  std::string edges_text;
};

inline constexpr double kLeastGridSpacingM = 0.1, kLargestGridSpacingM = 100;
inline constexpr std::size_t kMaxGridPoints = 10'000;

/// The points of walk_grid.h with free air from the knee to above the ears.  The ears are where the text of points.txt says, so that
/// `earshot rir` at these places gives the same bits.  Throws InputError: fewer than two points, or more than kMaxGridPoints.
GridPoints find_grid_points(const Scene& scene, const Navmesh& navmesh, double spacing_m, double ear_height_m);

}  // namespace earshot
