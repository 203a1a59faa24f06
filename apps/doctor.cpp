#include <dlfcn.h>
#include <embree3/rtcore.h>
#include <fmt/format.h>
#include <link.h>
#include <torch/torch.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "apps/commands.h"

namespace earshot {
namespace {

std::string cpu_model() {
  std::ifstream stream("/proc/cpuinfo");
  for (std::string line; std::getline(stream, line);)
    if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
  return "unknown";
}

/// Real path of the first loaded library whose file name contains `part`, or empty.
std::string loaded_library(const std::string& part) {
  struct Search {
    std::string part, found;
  } search{part, ""};
  dl_iterate_phdr(
      [](dl_phdr_info* info, std::size_t, void* data) {
        auto& wanted = *static_cast<Search*>(data);
        const std::filesystem::path path(info->dlpi_name);
        if (!wanted.found.empty() || path.filename().string().find(wanted.part) == std::string::npos) return 0;
        std::error_code error;
        wanted.found = std::filesystem::canonical(path, error).string();
        return 0;
      },
      &search);
  return search.found;
}

std::string embree_version() {
  struct Release {
    void operator()(RTCDevice device) const noexcept { rtcReleaseDevice(device); }
  };
  const std::unique_ptr<std::remove_pointer_t<RTCDevice>, Release> device{rtcNewDevice(nullptr)};
  if (!device) return "";
  return fmt::format("{}.{}.{}", rtcGetDeviceProperty(device.get(), RTC_DEVICE_PROPERTY_VERSION_MAJOR),
                     rtcGetDeviceProperty(device.get(), RTC_DEVICE_PROPERTY_VERSION_MINOR),
                     rtcGetDeviceProperty(device.get(), RTC_DEVICE_PROPERTY_VERSION_PATCH));
}

std::vector<std::string> render_nodes() {
  std::vector<std::string> nodes;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator("/dev/dri", error))
    if (entry.path().filename().string().starts_with("renderD")) nodes.push_back(entry.path().string());
  return nodes;
}

void line(const char* state, const char* what, const std::string& text) { fmt::print("{:<5} {:<10} {}\n", state, what, text); }

void run_doctor() {
  line("ok", "CPU", fmt::format("{}, {} cores", cpu_model(), std::thread::hardware_concurrency()));
#if defined(__x86_64__)
  const bool wide = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
  line(wide ? "ok" : "BAD", "vectors", wide ? "AVX2 and FMA" : "no AVX2: rebuild with -DEARSHOT_ARCH=x86-64");
#endif
  const std::string embree = embree_version();
  line(embree.empty() ? "BAD" : "ok", "Embree", embree.empty() ? "cannot be opened: apt-get install libembree-dev" : embree);

  const auto nodes = render_nodes();
  line("ok", "camera",
       nodes.empty() ? "Embree on the CPU (no GPU render node under /dev/dri)"
                     : "Embree on the CPU; GPU render node " + nodes.front() + " present");

  torch::set_num_threads(1);
  torch::mm(torch::ones({2, 2}), torch::ones({2, 2}));  // loads the BLAS
  std::string blas = loaded_library("libopenblas");
  if (blas.empty()) blas = loaded_library("libblas");
  const bool fast =
      blas.find("openblas") != std::string::npos || blas.find("mkl") != std::string::npos || blas.find("blis") != std::string::npos;
  line(fast ? "ok" : "SLOW", "BLAS",
       blas + (fast ? "" : ": the reference BLAS trains several times slower: apt-get install libopenblas0-pthread"));
  line("ok", "libtorch",
       fmt::format("{}, one thread per worker; {} cores make {} workers", TORCH_VERSION, std::thread::hardware_concurrency(),
                   std::thread::hardware_concurrency()));
  const char* data = std::getenv("EARSHOT_DATA");
  line("ok", "test data", data != nullptr ? data : "EARSHOT_DATA is not set: tests look for ../shared/data beside the project");
}

}  // namespace

void add_doctor(CLI::App& app) {
  app.add_subcommand("doctor", "What this machine has, what is missing and how to get it")->callback(run_doctor);
}

}  // namespace earshot
