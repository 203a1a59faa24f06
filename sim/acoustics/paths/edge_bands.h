// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <numbers>
#include <vector>

#include "sim/acoustics/core/arrival.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/paths/band_lanes.h"

namespace earshot {

/// Pressure factors of a face per band: the root of its specular reflectance (1 - absorption)(1 - scattering), and the root of what passes
/// straight through it.
struct FaceLanes {
  Lanes reflected{}, transmitted{};
};

/// Up to eight bands of a scene as its edges use them.
struct EdgeBands {
  int first, count;  ///< lane i is band first + i; lanes past `count` repeat the last one
  WaveLanes wave;
  Lanes air_per_m;              ///< loss of pressure
  std::vector<FaceLanes> face;  ///< by material
  /// Pressure factor of what passes a wedge straight: a sheet of one material once, faces of two materials one after the other.
  [[nodiscard]] Lanes transmitted(std::uint32_t first_material, std::uint32_t second_material) const {
    const Lanes& passed = face[first_material].transmitted;
    return first_material == second_material ? passed : passed * face[second_material].transmitted;
  }
  /// Pressure that is left of a path by spreading and air.
  [[nodiscard]] Lanes free_path(double distance_m) const {
    return exp_of_negative(air_per_m * static_cast<float>(-distance_m)) * static_cast<float>(0.25 * std::numbers::inv_pi / distance_m);
  }
};

/// All bands of a scene, low to high.
std::vector<EdgeBands> edge_bands(const AcousticScene& scene);

/// Sets amplitude and phase of the bands of a group, from the pressure over that of a free path.  Returns whether any is above 0.
bool set_bands(const EdgeBands& bands, const ComplexLanes& ratio, double distance_m, Arrival& arrival);

}  // namespace earshot
