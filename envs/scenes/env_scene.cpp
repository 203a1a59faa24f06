// SPDX-License-Identifier: Apache-2.0
#include "envs/scenes/env_scene.h"

#include <span>

namespace earshot {
namespace {

std::size_t bytes_of(const Appearance& appearance) {
  std::size_t bytes =
      std::as_bytes(std::span(appearance.triangle_color)).size() + std::as_bytes(std::span(appearance.triangle_category)).size();
  if (!appearance.detail) return bytes;
  const VisualMesh& mesh = appearance.detail->mesh;
  bytes += appearance.detail->rays.bytes() + std::as_bytes(std::span(mesh.vertices)).size() + std::as_bytes(std::span(mesh.uvs)).size() +
           std::as_bytes(std::span(mesh.colors)).size() + std::as_bytes(std::span(mesh.triangles)).size() +
           std::as_bytes(std::span(mesh.triangle_paint)).size();
  for (const Texture& texture : mesh.textures) bytes += texture.rgb.size();
  return bytes;
}

}  // namespace

std::shared_ptr<const Appearance> SceneLooks::of(const Scene& scene) {
  std::call_once(once_, [&] {
    appearance_ = load_appearance(scene);
    bytes_ = bytes_of(*appearance_);
  });
  return appearance_;
}

const WalkableMap& SceneFloor::of(const Navmesh& navmesh) {
  std::call_once(once_, [&] {
    map_ = std::make_unique<const WalkableMap>(navmesh);
    bytes_ = map_->bytes();
  });
  return *map_;
}

}  // namespace earshot
