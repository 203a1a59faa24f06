// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace earshot {

/// A device on which EGL may offer OpenGL ES 3 without a display.
struct EglDevice {
  int index = 0;                           ///< in the order in which EGL lists them, which need not be CUDA's; kSurfaceless
  std::string renderer = {};               ///< GL_RENDERER of a context on it; empty if none can be made
  std::string problem = {};                ///< reason if there is none
  std::string uuid = {};                   ///< 32 hexadecimal digits, or empty where the driver tells none
  std::optional<int> cuda = std::nullopt;  ///< CUDA's number of it
  bool software = true;                    ///< it computes on the CPU

  /// Index of the platform without surfaces, which EGL does not list as a device.
  static constexpr int kSurfaceless = -1;
  [[nodiscard]] bool surfaceless() const { return index == kSurfaceless; }
};

/// All devices that EGL lists; if there are none, the platform without surfaces where it gives a context.  Each is opened by a process of
/// its own (some 50 ms), so that a driver that crashes, hangs or ends its process becomes a `problem`. Throws RunError if that process
/// cannot be started (reader_program). Software is what says EGL_MESA_device_software, or whose GL_RENDERER is a known rasterizer on the
/// CPU: software devices may have a render node as well.
std::vector<EglDevice> list_egl_devices();

/// One of them, index as above; opened by a process of its own.
EglDevice probe_egl_device(int index);

/// The process's side: what earshot_reader answers to `egl QUESTION`.  Throws InputError for another question than it gets.
std::string answer_egl_probe(std::string_view question);

/// Whether GL_RENDERER is that of a rasterizer on the CPU (llvmpipe, softpipe, swrast, SwiftShader).
bool is_software_renderer(const std::string& renderer);

}  // namespace earshot
