// SPDX-License-Identifier: Apache-2.0
#include "sim/vision/egl_scene.h"

#include <cstddef>
#include <glm/geometric.hpp>

namespace earshot {
namespace {

glm::vec3 normal_of(glm::vec3 a, glm::vec3 b, glm::vec3 c) {
  const glm::dvec3 normal = glm::cross(glm::dvec3(b) - glm::dvec3(a), glm::dvec3(c) - glm::dvec3(a));
  const double length = glm::length(normal);
  return length > 0 ? glm::vec3(normal / length) : glm::vec3(0);
}

GlTexture upload_texture(const Texture& texture) {
  GlTexture name;
  glBindTexture(GL_TEXTURE_2D, name.get());
  glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
  glTexImage2D(GL_TEXTURE_2D, 0, GL_SRGB8, texture.width_px, texture.height_px, 0, GL_RGB, GL_UNSIGNED_BYTE, texture.rgb.data());
  // Texels are fetched one by one, but a texture without its smaller copies is complete only with these.
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
  return name;
}

}  // namespace

EglScene::EglScene(const Scene& scene, const Appearance* appearance) : has_appearance_(appearance != nullptr) {
  add_surface(scene, appearance);
  if (appearance && appearance->detail) add_detail(appearance->detail->mesh);
  check_gl("uploading a scene");
}

EglScene::Batch EglScene::upload(const std::vector<Vertex>& vertices) {
  Batch batch;
  batch.num_vertices = static_cast<GLsizei>(vertices.size());
  glBindVertexArray(batch.array.get());
  glBindBuffer(GL_ARRAY_BUFFER, batch.buffer.get());
  glBufferData(GL_ARRAY_BUFFER, static_cast<GLsizeiptr>(vertices.size() * sizeof(Vertex)), vertices.data(), GL_STATIC_DRAW);
  const auto floats = [](GLuint attribute, GLint count, std::size_t offset) {
    glEnableVertexAttribArray(attribute);
    glVertexAttribPointer(attribute, count, GL_FLOAT, GL_FALSE, sizeof(Vertex), reinterpret_cast<const void*>(offset));
  };
  floats(EglProgram::position, 3, offsetof(Vertex, position));
  floats(EglProgram::normal, 3, offsetof(Vertex, normal));
  floats(EglProgram::color, 3, offsetof(Vertex, color));
  floats(EglProgram::uv, 2, offsetof(Vertex, uv));
  glEnableVertexAttribArray(EglProgram::triangle);
  glVertexAttribIPointer(EglProgram::triangle, 1, GL_UNSIGNED_INT, sizeof(Vertex),
                         reinterpret_cast<const void*>(offsetof(Vertex, triangle)));
  glBindVertexArray(0);
  return batch;
}

void EglScene::add_surface(const Scene& scene, const Appearance* appearance) {
  const TriangleMesh& mesh = scene.mesh();
  normals_.reserve(mesh.triangles.size());
  std::vector<Vertex> vertices;
  vertices.reserve(3 * mesh.triangles.size());
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    const glm::uvec3 corners = mesh.triangles[t];
    normals_.push_back(normal_of(mesh.vertices[corners.x], mesh.vertices[corners.y], mesh.vertices[corners.z]));
    const glm::vec3 color = appearance ? appearance->triangle_color[t] : glm::vec3(1);
    for (int corner = 0; corner < 3; ++corner)
      vertices.push_back({mesh.vertices[corners[corner]], normals_.back(), color, glm::vec2(0), t});
  }
  if (!vertices.empty()) surface_.push_back(upload(vertices));
}

void EglScene::add_detail(const VisualMesh& mesh) {
  for (const Texture& texture : mesh.textures) {
    textures_.push_back(upload_texture(texture));
    wraps_.push_back({.width_px = texture.width_px, .height_px = texture.height_px, .wrap_u = texture.wrap_u, .wrap_v = texture.wrap_v});
  }
  // By texture, in the order of the file within each: few changes of state.  The last list has none.
  std::vector<std::vector<Vertex>> by_texture(mesh.textures.size() + 1);
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    const glm::uvec3 corners = mesh.triangles[t];
    const Paint& paint = mesh.paints[mesh.triangle_paint[t]];
    const glm::vec3 normal = normal_of(mesh.vertices[corners.x], mesh.vertices[corners.y], mesh.vertices[corners.z]);
    std::vector<Vertex>& vertices = paint.texture == Paint::no_texture ? by_texture.back() : by_texture[paint.texture];
    for (int corner = 0; corner < 3; ++corner) {
      const std::uint32_t vertex = corners[corner];
      vertices.push_back({mesh.vertices[vertex], normal, paint.base_color * mesh.colors[vertex], mesh.uvs[vertex], t});
    }
  }
  for (std::size_t i = 0; i < by_texture.size(); ++i) {
    if (by_texture[i].empty()) continue;
    detail_.push_back(upload(by_texture[i]));
    if (i < mesh.textures.size()) detail_.back().texture = static_cast<std::uint32_t>(i);
  }
}

void EglScene::draw(const std::vector<Batch>& batches, const EglProgram& program) const {
  for (const Batch& batch : batches) {
    const bool textured = batch.texture != Paint::no_texture;
    if (textured) glBindTexture(GL_TEXTURE_2D, textures_[batch.texture].get());
    program.set_texture(textured ? &wraps_[batch.texture] : nullptr);
    glBindVertexArray(batch.array.get());
    glDrawArrays(GL_TRIANGLES, 0, batch.num_vertices);
  }
}

}  // namespace earshot
