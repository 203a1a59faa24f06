// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "sim/scene/materials/materials.h"
#include "sim/scene/materials/semantic_materials.h"
#include "sim/scene/scene.h"

namespace earshot {

class ConfigReader;

/// How to vary the materials of a scene, so that a policy learned in it does not depend on one guess of them.
struct AcousticRandomization {
  std::uint64_t seed = 0;
  bool candidates = true;   ///< draw the material of each semantic category from its candidates; else keep it
  float noise_std = 0.05f;  ///< of Gaussian noise on each absorption and scattering coefficient, [0, 1]
  /// Of Gaussian noise on the transmission loss, dB, [0, 60].  Not on the coefficient: noise of 0.05 on a coefficient of 0.0001 would
  /// leave a wall that either transmits nothing or is an open window.
  float transmission_noise_db = 3.f;
};

/// Reads all fields but the seed.  Throws InputError.
void read(ConfigReader& reader, AcousticRandomization& randomization);

/// `material` with noise at the octave midbands 125 Hz to 8 kHz (exact midbands 1000 * 10^(0.3 k)); its curves are those points then.
/// Absorption and scattering are clipped to [0, 1]; transmission that was 0 stays 0, and none exceeds the absorption.  `scene` and `key`
/// pick the random numbers: a pure function of its arguments.
Material with_noise(const Material& material, const AcousticRandomization& randomization, std::string_view scene, std::string_view key);

/// One material per slot: where a semantic category applies (Material::category, else that of the slot's name if names are given), a random
/// one of its candidates in `database`, with noise; elsewhere the slot's own, with noise.  All slots of one category get the same material,
/// and those of one material without a category the same noise.  A pure function of (seed, scene, category): neither the other slots nor
/// their order matter.  scene: any text that names it; a path counts by its last component.  slot_names: one per material, or empty.
std::vector<Material> randomize_materials(std::string_view scene, std::span<const std::string> slot_names,
                                          std::span<const Material> materials, const SemanticMaterials& semantics,
                                          const MaterialDatabase& database, const AcousticRandomization& randomization);

/// The same scene with randomized materials, for a new episode.  Cost: a copy of the mesh and a new ray structure.
Scene randomize_materials(const Scene& scene, const SemanticMaterials& semantics, const MaterialDatabase& database,
                          const AcousticRandomization& randomization);

}  // namespace earshot
