// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "sim/base/text/config_key.h"
#include "sim/scene/acoustic_randomization.h"
#include "sim/scene/materials/material_assignment.h"
#include "sim/scene/readers/mesh_import.h"
#include "sim/scene/scene.h"

namespace earshot {

/// A scene YAML, validated.
///
///   mesh: ../meshes/house.glb        # required; relative to this file, or shoebox:... or house:...
///   up: y                            # axis that points up in the mesh file: y (default) or z
///   unit_m: 1                        # metres per unit of the mesh file
///   cell_m: 0.05                     # edge of the voxels of a point cloud; without it five times the median spacing of its points
///   ceiling_m: 3                     # adds a lid over the bounding rectangle at this height (world y, after up and unit_m); its
///                                    # slot and its object are called ceiling_lid
///   simplify_m: 0.01                 # lets the surface move by this much to save triangles (mesh_simplify.h); not done without it
///   materials: my_materials.json     # material database; the built-in one without it
///   coefficients: energy             # what the numbers of `materials` mean: energy or pressure; default: what the file says, else energy
///   annotations: rooms.house         # categories of the surfaces, where they are not beside the mesh by the names that data sets ship
///                                    # (annotations/annotation_files.h): .house, info_semantic.json or .semantic.txt
///   semantics: indoor                # materials by semantic category of mesh-material and node names: indoor, or a file as
///                                    # configs/semantic_materials.yaml; without it categories play no part
///   label_matching: exact            # labels of the database as whole words, or legacy_substring: as the predecessor does
///   randomize:                       # random materials (acoustic_randomization.h); {} takes these values; with candidates it implies
///                                    # semantics: indoor
///     {seed: 0, candidates: true, noise_std: 0.05, transmission_noise_db: 3}
///   assign: {"Wall*": gypsum_board}  # pattern over mesh-material or node names; order of precedence in material_assignment.h
///   default_material: default        # what no pattern matches
///   air: {temperature_c: 20, humidity_percent: 50, pressure_kpa: 101.325, speed_of_sound_m_per_s: 0}
///   two_sided: true                  # the only value: surfaces reflect from both sides
struct SceneConfig {
  std::string mesh;
  MeshImportOptions import;
  bool is_up_given = false, is_unit_given = false;
  std::optional<double> ceiling_m;  ///< in world coordinates
  std::optional<float> simplify_m;
  std::optional<std::filesystem::path> annotations;  ///< of the surfaces of a mesh file; found by its name without it
  std::optional<std::filesystem::path> materials;
  std::optional<CoefficientReading> coefficients;
  MaterialRules rules;
  bool own_semantics = false;  ///< rules.semantics come from a file: every material they name must be in the database
  std::optional<AcousticRandomization> randomization;
  Air air;
};

/// Paths come out resolved against the folder of the file.  Throws InputError: unknown key, wrong type or range, duplicate pattern.
SceneConfig read_scene_config(const std::filesystem::path& path);

/// All keys of a scene YAML.
std::vector<ConfigKey> scene_config_keys();

}  // namespace earshot
