// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

namespace earshot {

/// An OpenGL ES 3 context without a display, current on the thread that made it for as long as it lives; it must be destroyed there.  It
/// has no default framebuffer.
class EglContext {
 public:
  /// device: `auto` (the first hardware device), `software` (Mesa on the CPU), a number of list_egl_devices(), a UUID, or cuda:N.
  /// Throws InputError if there is no such device, or `auto` finds no hardware.
  explicit EglContext(const std::string& device);
  ~EglContext();
  EglContext(const EglContext&) = delete;
  EglContext& operator=(const EglContext&) = delete;

  [[nodiscard]] const std::string& renderer() const;  ///< GL_RENDERER
  [[nodiscard]] bool software() const;
  /// Whether the driver lost the context (reset of the device, memory fault): all objects in it are gone, it must be made anew.
  [[nodiscard]] bool is_lost() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace earshot
