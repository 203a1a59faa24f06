// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <vector>

#include "sim/scene/appearance.h"
#include "sim/scene/scene.h"
#include "sim/vision/egl_program.h"
#include "sim/vision/gl_objects.h"

namespace earshot {

/// The triangles and textures of one scene in the memory of the device, uploaded once.  48 bytes per corner.  Belongs to the thread of its
/// context.
class EglScene {
 public:
  /// appearance: null for depth and normals alone.  Throws RunError if the device has no memory for it.
  EglScene(const Scene& scene, const Appearance* appearance);

  [[nodiscard]] bool has_appearance() const { return has_appearance_; }
  /// Whether colours come from other triangles than all else (Appearance::Detail).
  [[nodiscard]] bool has_detail() const { return !detail_.empty(); }
  void draw_surface(const EglProgram& program) const { draw(surface_, program); }
  void draw_detail(const EglProgram& program) const { draw(detail_, program); }
  /// Unit, geometric, of each triangle of the scene's mesh; zero without an area.
  [[nodiscard]] const std::vector<glm::vec3>& normals() const { return normals_; }

 private:
  /// Triangles that share a texture.
  struct Batch {
    GlVertexArray array;
    GlBuffer buffer;
    GLsizei num_vertices = 0;
    std::uint32_t texture = Paint::no_texture;
  };
  struct Vertex {
    glm::vec3 position, normal, color;
    glm::vec2 uv;
    std::uint32_t triangle;
  };
  static Batch upload(const std::vector<Vertex>& vertices);
  void add_surface(const Scene& scene, const Appearance* appearance);
  void add_detail(const VisualMesh& mesh);
  void draw(const std::vector<Batch>& batches, const EglProgram& program) const;

  bool has_appearance_;
  std::vector<glm::vec3> normals_;
  std::vector<Batch> surface_, detail_;
  std::vector<GlTexture> textures_;
  std::vector<Texture> wraps_;  ///< sizes and wraps of the textures, without pixels
};

}  // namespace earshot
