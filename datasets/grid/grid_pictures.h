// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "datasets/corpus_folder.h"
#include "sim/vision/embree_camera.h"

namespace earshot {

/// Views from the points of a grid.  Immutable, safe from any thread.
class GridPictures {
 public:
  /// overrides: those the scene was loaded with.  Throws InputError for a size out of range.
  GridPictures(const Scene& scene, const SceneOverrides& overrides, int width_px, int height_px);
  /// What an agent at `foot` sees at the headings 0, 90, 180 and 270 degrees: PREFIX.rgb.npy, uint8 [4, H, W, 3], and PREFIX.depth.npy,
  /// float [4, H, W, 1], metres along the view axis divided by 10, at most 1.  The camera is 1.25 m above the floor, 90 degrees wide.
  [[nodiscard]] std::vector<CorpusFile> render(glm::vec3 foot, const std::string& prefix) const;
  /// Of the files of one point.
  [[nodiscard]] std::size_t bytes() const;

 private:
  const Scene& scene_;
  EmbreeCamera camera_;
  std::shared_ptr<const Appearance> appearance_;
};

}  // namespace earshot
