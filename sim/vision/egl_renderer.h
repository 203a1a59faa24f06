// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>

#include "sim/scene/appearance.h"
#include "sim/scene/scene.h"
#include "sim/vision/camera_sensor.h"

namespace earshot {

struct EglOptions {
  /// auto: the first hardware device; software: Mesa on the CPU; or a number of `earshot doctor`, a UUID, cuda:N.
  std::string device = "auto";
  /// Called from the renderer's thread with one line when the context was lost and made anew.  Empty: silent.
  std::function<void(const std::string& message)> warn = {};
};

/// One picture of a batch.
struct EglView {
  std::shared_ptr<const Scene> scene;
  std::shared_ptr<const Appearance> appearance;  ///< of the scene; needed for rgb and semantic, else it may be null
  Pose pose;
  CameraImages images;
};

/// All camera sensors by OpenGL ES 3 on EGL, without a display: a whole batch of views, read back at once.
///
///   EglRenderer renderer({.device = "auto"});                  // once per process; throws InputError where there is no hardware
///   renderer.render(config, views);                            // views: one per agent, of any scenes
///
/// Pictures are those of EmbreeCamera but for pixels on edges (docs/evidence/cameras.md has the shares), and for what is nearer than
/// kNearPlaneM, which is not drawn; a view has the same bits in every batch on the same device.  Pinholes only.  Geometry and textures of a
/// scene are uploaded when it first occurs, and dropped when the scene is: 144 bytes per triangle, and the textures.
///
/// One thread of its own owns the context.  render may be called from any thread, one call at a time is served, and each waits for its
/// pictures. A context that the driver loses is reported (warn), made anew with all scenes of the batch, and the batch is drawn again,
/// once.
class EglRenderer {
 public:
  /// Throws InputError if there is no such device; RunError if its driver fails.
  explicit EglRenderer(EglOptions options = {});
  ~EglRenderer();
  EglRenderer(const EglRenderer&) = delete;
  EglRenderer& operator=(const EglRenderer&) = delete;

  /// Fills the images of all views, which may ask for different ones.  Throws InputError for a config that is not a pinhole or out of
  /// range;
  /// RunError if the driver fails (memory, a context lost twice).
  void render(const CameraSensorConfig& config, std::span<const EglView> views);

  [[nodiscard]] const std::string& device_name() const { return device_name_; }  ///< GL_RENDERER
  [[nodiscard]] bool software() const { return software_; }
  [[nodiscard]] std::uint64_t contexts_lost() const;
  [[nodiscard]] std::uint64_t scenes_uploaded() const;
  /// For tests: the next batch finds its context lost.
  void lose_context();

 private:
  class Worker;
  std::unique_ptr<Worker> worker_;
  std::string device_name_;
  bool software_ = true;
};

}  // namespace earshot
