#pragma once

#include <optional>
#include <string>
#include <vector>

namespace earshot {

/// A device on which EGL offers OpenGL ES 3 without a display.
struct EglDevice {
  int index = 0;                           ///< in the order in which EGL lists them, which need not be CUDA's
  std::string renderer = {};               ///< GL_RENDERER of a context on it; empty if none can be made
  std::string problem = {};                ///< why there is none
  std::string uuid = {};                   ///< 32 hexadecimal digits, or empty where the driver tells none
  std::optional<int> cuda = std::nullopt;  ///< CUDA's number of it
  bool software = true;                    ///< it computes on the CPU
  bool surfaceless = false;                ///< not a device that EGL lists, but what the platform without surfaces gives; index -1
};

/// All of them, each with a context made and dropped (some 50 ms).  Never throws: a machine without any gives an empty list.
/// Software is what says EGL_MESA_device_software, or whose GL_RENDERER is a known rasterizer on the CPU: software devices may have a
/// render node as well.
std::vector<EglDevice> list_egl_devices();

/// Whether GL_RENDERER is that of a rasterizer on the CPU (llvmpipe, softpipe, swrast, SwiftShader).
bool is_software_renderer(const std::string& renderer);

}  // namespace earshot
