// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "sim/rays/embree_scene.h"
#include "sim/scene/scene.h"
#include "sim/scene/visual_mesh.h"

namespace earshot {

/// Colours and categories of the surfaces of a scene, built beside the Scene on request.  Immutable, shared
/// by all renderers and threads.
struct Appearance {
  // Per triangle of scene.mesh(), and so of Hit::triangle of scene.rays().
  std::vector<glm::vec3> triangle_color;         ///< linear light, of the material as a whole
  std::vector<std::uint16_t> triangle_category;  ///< index into category_names(); 0: none is known
  /// Where textures or colours of vertices say more than triangle_color: the file's own triangles, and rays for them.  Colours then come
  /// from here, depth, categories and normals still from the scene.
  struct Detail {
    VisualMesh mesh;
    EmbreeScene rays;
  };
  std::optional<Detail> detail;
  std::vector<std::string> warnings;  ///< one line each
};

/// Settings of load_appearance.
struct AppearanceOptions {
  int largest_texture_px = 1024;  ///< larger textures are halved until they fit
  bool detail = true;  ///< false: no textures and no colours of vertices, only triangle_color (which is white where a file has those alone)
};

/// Names of the semantic categories by number: 0 is "unknown", then come those of configs/semantic_materials.yaml in the order of the
/// alphabet, and last "agent", which bodies of agents are (sim/vision/agent_body.h).  The same for all scenes.
const std::vector<std::string>& category_names();

/// Reads the file of the scene once more for its looks (visual_mesh.h); generated scenes and files without colours take those of
/// surface_palette.h.  The category of a triangle is that of its node's name, else of its mesh material's name (numbers and single
/// letters at the end left out: NightStandA_01 is a nightstand), else the one by which its acoustic material was chosen.  overrides: those
/// the scene was loaded with.  Throws InputError.  About as long as load_scene for a mesh file, a millisecond per 10,000 triangles for
/// generated scenes; safe from any thread.
std::shared_ptr<const Appearance> load_appearance(const Scene& scene, const SceneOverrides& overrides = {},
                                                  const AppearanceOptions& options = {});

}  // namespace earshot
