// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <memory>
#include <string>
#include <vector>

#include "datasets/corpus_folder.h"
#include "datasets/rir_corpus_config.h"
#include "sim/vision/embree_camera.h"

namespace earshot {

/// Panoramas of one room.  Immutable, safe from any thread.
class CorpusPictures {
 public:
  CorpusPictures(const CorpusPanorama& config, const Scene& scene);
  /// The view from `position`, level, the heading in the middle: ID.rgb.png, ID.depth.png (16 bits: millimetres along the ray, with
  /// config.views along the axis of each view; 65535 beyond and where nothing is hit) and ID.category.png (a palette, the indices are the
  /// categories).
  [[nodiscard]] std::vector<CorpusFile> render(const Scene& scene, glm::vec3 position, double heading_rad, const std::string& id) const;

 private:
  std::vector<EmbreeCamera> cameras_;  ///< from left to right, of equal width
  int width_px_, height_px_;           ///< of the whole picture
  std::shared_ptr<const Appearance> appearance_;
};

}  // namespace earshot
