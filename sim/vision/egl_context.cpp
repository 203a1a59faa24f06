// SPDX-License-Identifier: Apache-2.0
#include "sim/vision/egl_context.h"

#include <EGL/egl.h>
#include <EGL/eglext.h>
#include <GLES3/gl3.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <optional>
#include <string_view>
#include <vector>

#include "sim/base/errors.h"
#include "sim/vision/egl_device.h"
#include "sim/vision/egl_driver.h"
#include "sim/vision/egl_opening.h"

namespace earshot {
namespace {

// Whole words of a list that blanks separate.
bool has_extension(const char* list, std::string_view wanted) {
  if (!list) return false;
  std::string_view rest(list);
  while (!rest.empty()) {
    const std::size_t end = std::min(rest.find(' '), rest.size());
    if (rest.substr(0, end) == wanted) return true;
    rest.remove_prefix(std::min(end + 1, rest.size()));
  }
  return false;
}

/// The first call of EGL on every way in.
const char* client_extensions() {
  keep_driver_symbols_apart();
  return eglQueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS);
}

template <class Function>
Function load(const char* name) {
  return reinterpret_cast<Function>(eglGetProcAddress(name));
}

using ResetStatus = GLenum (*)();

std::string egl_problem(const char* doing) { return fmt::format("{} failed with EGL error 0x{:04X}", doing, eglGetError()); }

std::vector<EGLDeviceEXT> query_devices() {
  if (!has_extension(client_extensions(), "EGL_EXT_platform_device")) return {};
  const auto query = load<PFNEGLQUERYDEVICESEXTPROC>("eglQueryDevicesEXT");
  if (!query) return {};
  EGLint count = 0;
  if (query(0, nullptr, &count) == EGL_FALSE || count <= 0) return {};
  std::vector<EGLDeviceEXT> devices(static_cast<std::size_t>(count));
  if (query(count, devices.data(), &count) == EGL_FALSE) return {};
  devices.resize(static_cast<std::size_t>(std::max(count, 0)));
  return devices;
}

const char* device_extensions(EGLDeviceEXT device) {
  const auto query = load<PFNEGLQUERYDEVICESTRINGEXTPROC>("eglQueryDeviceStringEXT");
  return query ? query(device, EGL_EXTENSIONS) : nullptr;
}

std::string uuid_of(EGLDeviceEXT device) {
  const auto query = load<PFNEGLQUERYDEVICEBINARYEXTPROC>("eglQueryDeviceBinaryEXT");
  std::array<unsigned char, 16> bytes{};
  EGLint size = 0;
  if (!query || !has_extension(device_extensions(device), "EGL_EXT_device_persistent_id") ||
      query(device, EGL_DEVICE_UUID_EXT, static_cast<EGLint>(bytes.size()), bytes.data(), &size) == EGL_FALSE || size != 16)
    return {};
  std::string text;
  for (const unsigned char byte : bytes) text += fmt::format("{:02x}", byte);
  return text;
}

std::optional<int> cuda_number(EGLDeviceEXT device) {
  const auto query = load<PFNEGLQUERYDEVICEATTRIBEXTPROC>("eglQueryDeviceAttribEXT");
  EGLAttrib number = 0;
  if (!query || !has_extension(device_extensions(device), "EGL_NV_device_cuda") || query(device, EGL_CUDA_DEVICE_NV, &number) == EGL_FALSE)
    return std::nullopt;
  return static_cast<int>(number);
}

/// A context that is current on this thread.  eglTerminate is not called: a display is shared by all who ask for the same device.
struct CurrentContext {
  EGLDisplay display = EGL_NO_DISPLAY;
  EGLContext context = EGL_NO_CONTEXT;
  std::string renderer, problem;

  CurrentContext() = default;
  CurrentContext(const CurrentContext&) = delete;
  CurrentContext& operator=(const CurrentContext&) = delete;
  ~CurrentContext() {
    if (context == EGL_NO_CONTEXT) return;
    eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
    eglDestroyContext(display, context);
  }

  /// Whether it is there; else `problem` says why not.
  bool open(EGLenum platform, void* native) {
    const auto get_display = load<PFNEGLGETPLATFORMDISPLAYEXTPROC>("eglGetPlatformDisplayEXT");
    display = get_display ? get_display(platform, native, nullptr) : EGL_NO_DISPLAY;
    EGLint major = 0, minor = 0;
    if (display == EGL_NO_DISPLAY || eglInitialize(display, &major, &minor) == EGL_FALSE) return fail(egl_problem("opening the display"));
    if (!has_extension(eglQueryString(display, EGL_EXTENSIONS), "EGL_KHR_surfaceless_context"))
      return fail("the display has no EGL_KHR_surfaceless_context");
    eglBindAPI(EGL_OPENGL_ES_API);
    const EGLint wanted[] = {EGL_RENDERABLE_TYPE, EGL_OPENGL_ES3_BIT, EGL_SURFACE_TYPE, 0, EGL_NONE};
    EGLConfig config = nullptr;
    EGLint count = 0;
    if (eglChooseConfig(display, wanted, &config, 1, &count) == EGL_FALSE || count < 1)
      return fail(egl_problem("choosing a config for ES 3"));
    // With notification of resets where the driver has it: without, a lost context shows as black pictures.
    const EGLint robust[] = {EGL_CONTEXT_MAJOR_VERSION,
                             3,
                             EGL_CONTEXT_MINOR_VERSION,
                             0,
                             EGL_CONTEXT_OPENGL_ROBUST_ACCESS,
                             EGL_TRUE,
                             EGL_CONTEXT_OPENGL_RESET_NOTIFICATION_STRATEGY,
                             EGL_LOSE_CONTEXT_ON_RESET,
                             EGL_NONE};
    const EGLint plain[] = {EGL_CONTEXT_MAJOR_VERSION, 3, EGL_CONTEXT_MINOR_VERSION, 0, EGL_NONE};
    if (major > 1 || minor >= 5) context = eglCreateContext(display, config, EGL_NO_CONTEXT, robust);
    if (context == EGL_NO_CONTEXT) context = eglCreateContext(display, config, EGL_NO_CONTEXT, plain);
    if (context == EGL_NO_CONTEXT) return fail(egl_problem("making a context of ES 3"));
    if (eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context) == EGL_FALSE)
      return fail(egl_problem("making the context current"));
    const auto* name = reinterpret_cast<const char*>(glGetString(GL_RENDERER));
    renderer = name ? name : "";
    return renderer.empty() ? fail("the context reports no renderer") : true;
  }

 private:
  bool fail(std::string problem_text) {
    problem = std::move(problem_text);
    return false;
  }
};

bool open_device(CurrentContext& current, EGLDeviceEXT device) { return current.open(EGL_PLATFORM_DEVICE_EXT, device); }

bool open_surfaceless(CurrentContext& current) {
  if (has_extension(client_extensions(), "EGL_MESA_platform_surfaceless"))
    return current.open(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY);
  current.problem = "EGL has no EGL_MESA_platform_surfaceless";
  return false;
}

std::string folded_uuid(const std::string& text) {
  std::string digits;
  for (const char letter : std::string_view(text).substr(text.starts_with("GPU-") ? 4 : 0))
    if (letter != '-') digits += static_cast<char>(std::tolower(static_cast<unsigned char>(letter)));
  return digits;
}

std::optional<int> whole_number(std::string_view text) {
  int number = -1;
  const auto parsed = std::from_chars(text.data(), text.data() + text.size(), number);
  return parsed.ec == std::errc() && parsed.ptr == text.data() + text.size() && number >= 0 ? std::optional(number) : std::nullopt;
}

[[noreturn]] void refuse(const std::string& device, const std::string& problem) {
  throw InputError("egl device " + device, problem,
                   "run 'earshot doctor' for a list of devices; the embree renderer needs none, and `software` uses Mesa on the CPU");
}

}  // namespace

bool is_software_renderer(const std::string& renderer) {
  std::string folded;
  for (const char letter : renderer) folded += static_cast<char>(std::tolower(static_cast<unsigned char>(letter)));
  for (const char* known : {"llvmpipe", "softpipe", "swrast", "software rasterizer", "swiftshader", "lavapipe"})
    if (folded.find(known) != std::string::npos) return true;
  return false;
}

int count_egl_devices() { return static_cast<int>(query_devices().size()); }

EglDevice open_egl_device(int index) {
  CurrentContext current;
  EglDevice found{.index = index};
  bool says_software = false, opens = false;
  if (index == EglDevice::kSurfaceless) {
    opens = open_surfaceless(current);
  } else {
    const std::vector<EGLDeviceEXT> devices = query_devices();
    if (index < 0 || static_cast<std::size_t>(index) >= devices.size()) {
      found.problem = fmt::format("is not one of the {} devices that EGL lists", devices.size());
      return found;
    }
    const EGLDeviceEXT device = devices[static_cast<std::size_t>(index)];
    opens = open_device(current, device);
    found.uuid = uuid_of(device);
    found.cuda = cuda_number(device);
    says_software = has_extension(device_extensions(device), "EGL_MESA_device_software");
  }
  found.renderer = current.renderer;
  found.problem = current.problem;
  found.software = says_software || (opens && is_software_renderer(current.renderer));
  return found;
}

struct EglContext::Impl {
  CurrentContext current;
  bool software = true;
  ResetStatus reset_status = nullptr;

  /// Opens what `device` names.  Every device is probed in another process first: of a driver that crashes there only the report comes
  /// here.
  void open(const std::string& device) {
    const bool any_hardware = device == "auto", any_software = device == "software";
    const std::optional<int> number = whole_number(device);
    const std::optional<int> cuda = device.starts_with("cuda:") ? whole_number(std::string_view(device).substr(5)) : std::nullopt;
    const std::string uuid = folded_uuid(device);
    const std::vector<EglDevice> devices = list_egl_devices();
    std::string problem;
    for (const EglDevice& listed : devices) {
      const bool named = !listed.surfaceless() && (number ? *number == listed.index
                                                   : cuda ? cuda == listed.cuda
                                                          : uuid.size() == 32 && listed.uuid == uuid);
      const bool wanted = named || ((any_hardware || any_software) && listed.software == any_software);
      if (!wanted) continue;
      if (!listed.renderer.empty()) return take(device, listed);
      problem = listed.problem;
      if (named) refuse(device, problem);
    }
    if (!any_hardware && !any_software)
      refuse(device, fmt::format("is not one of the {} devices of EGL on this machine; use a number, a UUID, cuda:N, auto or software",
                                 devices.size()));
    const EglDevice surfaceless = probe_egl_device(EglDevice::kSurfaceless);
    if (!surfaceless.renderer.empty() && surfaceless.software == any_software) return take(device, surfaceless);
    if (problem.empty()) problem = surfaceless.problem;
    const std::string why = problem.empty() ? "" : " (" + problem + ")";
    refuse(device, any_hardware ? "found no GPU with OpenGL ES 3" + why : "found no software renderer" + why + ": install libgl1-mesa-dri");
  }

  /// Opens a probed device in this process.  device: its name in the user's config.
  void take(const std::string& device, const EglDevice& probed) {
    CurrentContext from;
    const std::vector<EGLDeviceEXT> devices = query_devices();
    const bool opens = probed.surfaceless() ? open_surfaceless(from)
                       : static_cast<std::size_t>(probed.index) < devices.size()
                           ? open_device(from, devices[static_cast<std::size_t>(probed.index)])
                           : false;
    if (!opens) refuse(device, from.problem.empty() ? "is no longer listed by EGL" : from.problem);
    software = probed.software;
    std::swap(current.display, from.display);
    std::swap(current.context, from.context);
    current.renderer = std::move(from.renderer);
    for (const char* name : {"glGetGraphicsResetStatus", "glGetGraphicsResetStatusKHR", "glGetGraphicsResetStatusEXT"}) {
      const auto* extensions = reinterpret_cast<const char*>(glGetString(GL_EXTENSIONS));
      GLint major = 0, minor = 0;
      glGetIntegerv(GL_MAJOR_VERSION, &major);
      glGetIntegerv(GL_MINOR_VERSION, &minor);
      const std::string_view ending = std::string_view(name).substr(24);
      const bool is_supported = ending == "KHR"   ? has_extension(extensions, "GL_KHR_robustness")
                                : ending == "EXT" ? has_extension(extensions, "GL_EXT_robustness")
                                                  : major > 3 || (major == 3 && minor >= 2);
      if (is_supported && !reset_status) reset_status = load<ResetStatus>(name);
    }
  }
};

EglContext::EglContext(const std::string& device) : impl_(std::make_unique<Impl>()) { impl_->open(device); }
EglContext::~EglContext() = default;
const std::string& EglContext::renderer() const { return impl_->current.renderer; }
bool EglContext::software() const { return impl_->software; }
bool EglContext::is_lost() const { return impl_->reset_status && impl_->reset_status() != GL_NO_ERROR; }

}  // namespace earshot
