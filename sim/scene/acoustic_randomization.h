// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "sim/scene/materials/materials.h"
#include "sim/scene/materials/semantic_materials.h"
#include "sim/scene/mesh/triangle_mesh.h"
#include "sim/scene/scene.h"

namespace earshot {

class ConfigReader;

/// Standard deviation of the noise of SoundSpaces 2.0 (Chen et al. 2022, supplement: N(0, 0.1)), the default of corpora.
inline constexpr float kPaperNoiseStd = 0.1f;

/// What gets one draw of a material and its noise.
enum class RandomizedUnit {
  category,  ///< all surfaces of a semantic category; those without one by their material
  object     ///< each object of the mesh: two chairs differ
};

/// How to vary the materials of a scene, so that a policy learned in it does not depend on one guess of them.
struct AcousticRandomization {
  std::uint64_t seed = 0;
  bool candidates = true;  ///< draw the material of each semantic category from its candidates; else keep it
  RandomizedUnit per = RandomizedUnit::category;
  /// Absorption and scattering of each octave are drawn uniformly from [0, 1], whatever the material; else they get Gaussian noise.
  bool uniform = false;
  float noise_std = 0.05f;  ///< of Gaussian noise on the mean of each octave of absorption and scattering, [0, 1]; no effect with uniform
  /// Between the noise of neighbouring octaves, [0, 1]; of Gaussian noise the k-th power between octaves k apart.
  float noise_correlation = 0;
  /// Of Gaussian noise on the transmission loss, dB, [0, 60].  Not on the coefficient: noise of 0.05 on a coefficient of 0.0001 would
  /// leave a wall that either transmits nothing or is an open window.
  float transmission_noise_db = 3.f;
};

/// Reads all fields but the seed.  Throws InputError.
void read(ConfigReader& reader, AcousticRandomization& randomization);

/// `material` with noise that is constant within each octave from 63 Hz to 16 kHz (base-ten octaves, as bands.h; the outer ones go on
/// beyond), so that the mean over an octave varies as asked, and steps at their edges within 1e-5 of the frequency.  Absorption and
/// scattering are clipped to [0, 1]; transmission that was 0 stays 0, and none exceeds the absorption.  A measured impedance stays if
/// noise_std is 0 and uniform is false; else there is none, and one follows from the noisy absorption where it is asked for.  `scene` and
/// `key` pick the random numbers: a pure function of its arguments.
Material with_noise(const Material& material, const AcousticRandomization& randomization, std::string_view scene, std::string_view key);

/// One material per slot: where a semantic category applies (Material::category, else that of the slot's name if names are given), a random
/// one of its candidates in `database`, with noise; elsewhere the slot's own, with noise.  All slots of one category get the same material,
/// and those of one material without a category the same noise.  A pure function of (seed, scene, category): neither the other slots nor
/// their order matter.  scene: any text that names it; a path counts by its last component.  slot_names: one per material, or empty.
std::vector<Material> randomize_materials(std::string_view scene, std::span<const std::string> slot_names,
                                          std::span<const Material> materials, const SemanticMaterials& semantics,
                                          const MaterialDatabase& database, const AcousticRandomization& randomization);

/// The same for a mesh with one material per slot; with RandomizedUnit::object every object of a slot gets a slot of its own, named
/// "SLOT/OBJECT", and two objects of a category may be of different materials.  use_slot_names: as slot_names above.
void randomize_materials(std::string_view scene, TriangleMesh& mesh, std::vector<Material>& materials, ImportReport& report,
                         bool use_slot_names, const SemanticMaterials& semantics, const MaterialDatabase& database,
                         const AcousticRandomization& randomization);

/// The name of a slot before its objects got slots of their own: "SLOT" of "SLOT/OBJECT"; other names are as they are.
std::string_view without_object(std::string_view slot, std::string_view object);

/// The same scene with randomized materials, for a new episode.  Cost: a copy of the mesh and a new ray structure.
Scene randomize_materials(const Scene& scene, const SemanticMaterials& semantics, const MaterialDatabase& database,
                          const AcousticRandomization& randomization);

}  // namespace earshot
