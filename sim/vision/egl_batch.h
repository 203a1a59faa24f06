// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "sim/vision/egl_context.h"
#include "sim/vision/egl_program.h"
#include "sim/vision/egl_renderer.h"
#include "sim/vision/egl_scene.h"
#include "sim/vision/gl_objects.h"

namespace earshot {

/// Where every view is drawn: integers, which every driver of ES 3 can render to.  The same corner of the same size for each, so that a
/// picture has the same bits in every batch; in a larger picture of many views, rounding would depend on the place.
struct EglTarget {
  int width_px = 0, height_px = 0;
  GlFramebuffer framebuffer;
  GlRenderbuffer pixels, depth;
};

/// A context with everything that lives in it: program, target and scenes.  Made, used and destroyed by one thread.
class EglBatch {
 public:
  explicit EglBatch(const std::string& device);

  /// False if the context was lost on the way: no picture counts, and this object can only be destroyed.
  [[nodiscard]] bool render(const CameraSensorConfig& config, std::span<const EglView> views);
  [[nodiscard]] const EglContext& context() const { return context_; }
  [[nodiscard]] std::uint64_t scenes_uploaded() const { return scenes_uploaded_; }

 private:
  struct Kept {
    std::weak_ptr<const Scene> scene;
    std::weak_ptr<const Appearance> appearance;
    std::unique_ptr<EglScene> uploaded;
  };
  EglScene& upload(const EglView& view);
  void drop_dead_scenes();
  void require_target(int width_px, int height_px);
  void draw(const CameraSensorConfig& config, const EglView& view);
  void unpack(const CameraSensorConfig& config, const EglView& view, std::span<const PixelWord> words) const;

  EglContext context_;  // outlives what was made in it
  EglProgram program_;
  std::optional<EglTarget> target_;
  GlBuffer pictures_;  ///< of the batch, on their way to this machine's memory: one wait for all
  std::map<const Scene*, Kept> scenes_;
  int largest_side_px_ = 0;
  std::uint64_t scenes_uploaded_ = 0;
};

}  // namespace earshot
