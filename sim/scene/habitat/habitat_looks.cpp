// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/habitat/habitat_looks.h"

#include <glm/common.hpp>
#include <glm/mat4x4.hpp>
#include <glm/matrix.hpp>
#include <utility>

#include "sim/base/errors.h"
#include "sim/scene/habitat/habitat_scene.h"

namespace earshot {
namespace {

/// Whether each axis of the asset becomes an axis of the scene before it is turned, so that its box becomes a box.
bool keeps_axes(const Placement& placement) {
  for (int column = 0; column < 3; ++column) {
    int parts = 0;
    for (int row = 0; row < 3; ++row) parts += placement.frame[column][row] != 0;
    if (parts != 1) return false;
  }
  return true;
}

/// What matrix_of reads of a mesh: two corners of its box, or all vertices where the box would not do.
TriangleMesh extent_of(const TriangleMesh& mesh, bool as_box) {
  TriangleMesh extent;
  extent.origin_m = mesh.origin_m;
  extent.vertices = mesh.vertices;
  if (!as_box || mesh.vertices.empty()) return extent;
  glm::vec3 lower = mesh.vertices[0], upper = lower;
  for (const glm::vec3 vertex : mesh.vertices) {
    lower = glm::min(lower, vertex);
    upper = glm::max(upper, vertex);
  }
  extent.vertices = {lower, upper};
  return extent;
}

class LooksAssembler {
 public:
  LooksAssembler(glm::dvec3 origin_m, int largest_texture_px) : origin_m_(origin_m), largest_texture_px_(largest_texture_px) {}

  void add(const PlacedAsset& asset) {
    const bool as_box = keeps_axes(asset.placement);
    TriangleMesh& extent = extents_[{asset.mesh, as_box}];
    if (asset.placement.is_centered_on_box && extent.vertices.empty()) extent = extent_of(import_mesh(asset.mesh).mesh, as_box);
    const glm::dmat4 to_world = matrix_of(asset.placement, extent);
    const auto [place, is_new] = parts_.try_emplace(asset.mesh);
    Part& part = place->second;
    if (is_new) read(asset, to_world, part);
    const auto first = static_cast<std::uint32_t>(all_.vertices.size());
    if (all_.vertices.size() + part.mesh.vertices.size() >= 0xFFFFFFFFu)
      throw InputError(asset.mesh.string(), "brings the scene above 4 billion vertices", "simplify it");
    for (const glm::vec3 vertex : part.mesh.vertices)
      all_.vertices.emplace_back(glm::dvec3(to_world * glm::dvec4(glm::dvec3(vertex) + part.base, 1)) - origin_m_);
    all_.uvs.insert(all_.uvs.end(), part.mesh.uvs.begin(), part.mesh.uvs.end());
    all_.colors.insert(all_.colors.end(), part.mesh.colors.begin(), part.mesh.colors.end());
    for (const glm::uvec3 corners : part.mesh.triangles) all_.triangles.push_back(corners + first);
    for (const std::uint32_t paint : part.mesh.triangle_paint) all_.triangle_paint.push_back(paint + part.first_paint);
  }

  VisualMesh finish() { return std::move(all_); }

 private:
  struct Part {
    VisualMesh mesh;     ///< without paints and textures, which are in all_
    glm::dvec3 base{0};  ///< of its vertices, in the coordinates of the asset
    std::uint32_t first_paint = 0;
  };

  void read(const PlacedAsset& asset, const glm::dmat4& to_world, Part& part) {
    part.base = glm::dvec3(glm::inverse(to_world) * glm::dvec4(origin_m_, 1));
    part.mesh = read_visual_mesh(asset.mesh, {}, part.base, largest_texture_px_);
    part.first_paint = static_cast<std::uint32_t>(all_.paints.size());
    const auto first_texture = static_cast<std::uint32_t>(all_.textures.size());
    for (Paint paint : std::exchange(part.mesh.paints, {})) {
      if (paint.texture != Paint::no_texture) paint.texture += first_texture;
      all_.paints.push_back(paint);
    }
    for (Texture& texture : part.mesh.textures) all_.textures.push_back(std::move(texture));
    part.mesh.textures.clear();
    all_.varies = all_.varies || part.mesh.varies || !part.mesh.color_of_material.empty();
    all_.color_of_material.merge(part.mesh.color_of_material);
    for (std::string& warning : part.mesh.warnings) all_.warnings.push_back(std::move(warning));
  }

  glm::dvec3 origin_m_;
  int largest_texture_px_;
  VisualMesh all_;
  std::map<std::filesystem::path, Part> parts_;
  std::map<std::pair<std::filesystem::path, bool>, TriangleMesh> extents_;  ///< of assets that are placed by the middle of their box
};

}  // namespace

VisualMesh read_habitat_looks(const std::string& spec, glm::dvec3 origin_m, int largest_texture_px) {
  const HabitatScene scene = read_habitat_scene(spec);
  LooksAssembler assembler(origin_m, largest_texture_px);
  assembler.add(scene.stage);
  for (const PlacedAsset& object : scene.objects) assembler.add(object);
  return assembler.finish();
}

}  // namespace earshot
