// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "sim/scene/annotations/annotation_files.h"
#include "sim/scene/gltf_look.h"
#include "sim/scene/readers/surface_names.h"
#include "sim/scene/texture.h"

namespace earshot {

/// Names of triangles from a file of annotations, which is read when a surface that carries a number or a colour first asks for it.
class AnnotatedSurfaces : public SurfaceNames {
 public:
  explicit AnnotatedSurfaces(AnnotationFiles files) : files_(std::move(files)) {}

  [[nodiscard]] const std::vector<SurfaceName>& all() const override { return annotations_->names(); }
  [[nodiscard]] std::vector<std::uint32_t> of_faces(std::span<const std::int64_t> ids) override;
  /// By the colour of its vertices (two of three decide), else by that of its texture, at four points of the triangle.
  [[nodiscard]] std::vector<std::uint32_t> of_primitive(const GltfPrimitive& primitive) override;
  /// Whether a surface carried what the annotations name: numbers of faces, or colours where the annotations have colours.
  [[nodiscard]] bool is_used() const { return carries_; }

 private:
  const Annotations& annotations();
  void name_by_vertex_colors(const GltfPrimitive& primitive, std::vector<std::uint32_t>& names);
  void name_by_texture(const GltfPrimitive& primitive, std::vector<std::uint32_t>& names);
  /// The texture of this look; null where it is neither PNG nor JPEG.
  const Texture* texture_of(const GltfAsset& asset, const GltfLook& look);

  AnnotationFiles files_;
  std::optional<Annotations> annotations_;
  bool carries_ = false;
  std::optional<std::size_t> image_;  ///< that texture_ holds: one at a time, of up to 200 MB
  std::optional<Texture> texture_;
};

}  // namespace earshot
