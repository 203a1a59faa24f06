// SPDX-License-Identifier: Apache-2.0
#include <dlfcn.h>
#include <fmt/format.h>
#include <link.h>

#include <algorithm>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "apps/commands.h"
#include "apps/options/output_options.h"
#include "apps/training/blas_kernel.h"
#include "policy/torch_info.h"
#include "policy/torch_kernels.h"
#include "policy/torch_threads.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/process/isolated_call.h"
#include "sim/base/processor.h"
#include "sim/base/text/json.h"
#include "sim/base/text/listed.h"
#include "sim/base/version.h"
#include "sim/rays/embree_options.h"
#include "sim/rays/ray_tracer_version.h"
#include "sim/vision/egl_device.h"

namespace earshot {
namespace {

/// ok: works.  slow: works, at a cost that the line names.  absent: not there, and nothing of the product needs it.  bad: must be remedied.
enum class State { ok, slow, absent, bad };

struct Finding {
  State state;
  std::string text;
};

std::string cpu_model() {
  std::ifstream stream("/proc/cpuinfo");
  for (std::string line; std::getline(stream, line);)
    if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
  return "unknown model";
}

Finding check_vectors() {
  std::vector<std::string> used, unused;
  const unsigned present = present_instruction_sets();
  for (std::size_t set = 0; set < std::size(kInstructionSets); ++set) {
    const unsigned bit = 1u << set;
    if ((kUsedInstructionSets & bit) != 0)
      used.emplace_back(kInstructionSets[set]);
    else if ((present & bit) != 0)
      unused.emplace_back(kInstructionSets[set]);
  }
  std::string text = used.empty() ? "compiled for the plain instruction set" : fmt::format("compiled for {}", listed(used, ", "));
  if (!unused.empty()) text += fmt::format("; the CPU also has {}", listed(unused, ", "));
  const bool lacks_fast_kernels = (present & ~kUsedInstructionSets & kDefaultInstructionSets) != 0;
  if (lacks_fast_kernels) text += ": configure without -DEARSHOT_ARCH";
  return {lacks_fast_kernels ? State::slow : State::ok, text};
}

Finding check_embree() {
  try {
    return {State::ok,
            fmt::format("{}, {} instructions, for sound and for the camera, on the CPU", ray_tracer_version(), ray_tracer_isa())};
  } catch (const InputError& error) {
    return {State::bad, error.what()};
  }
}

/// One finding per device that can draw pictures, and what they mean.
std::vector<Finding> check_egl() {
  std::vector<Finding> findings;
  std::vector<EglDevice> devices;
  try {
    devices = list_egl_devices();
  } catch (const RunError& error) {
    return {{State::absent, fmt::format("was not probed: {}", error.what())}};  // the line of the reader has the remedy
  }
  for (const EglDevice& device : devices) {
    std::string text = device.surfaceless() ? "without a device (surfaceless)" : fmt::format("device {}", device.index);
    if (!device.uuid.empty()) text += fmt::format(", UUID {}", device.uuid);
    if (device.cuda) text += fmt::format(", cuda:{}", *device.cuda);
    if (device.renderer.empty()) {
      findings.push_back({State::absent, fmt::format("{} does not provide OpenGL ES 3: {}", text, device.problem)});
    } else if (device.software) {
      findings.push_back({State::absent, fmt::format("{}: {} runs on the CPU and is slower than Embree; used only with device `software`",
                                                     text, device.renderer)});
    } else {
      findings.push_back({State::ok, fmt::format("{}: {}", text, device.renderer)});
    }
  }
  if (findings.empty())
    findings.push_back({State::absent,
                        "no device: cameras use Embree; to use a GPU install its driver with EGL, to run the EGL tests without one install "
                        "libgl1-mesa-dri"});
  return findings;
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

bool has_ray_isa(std::string_view name) {
  const std::vector<RayIsa> isas = ray_isas();
  return std::any_of(isas.begin(), isas.end(), [&](const RayIsa& isa) { return isa.name == name && isa.present; });
}

/// Of a BLAS that trains fast: the library, and the processor whose kernels it has chosen.
Finding fast_blas(const std::string& path) {
  const std::string kernel = torch_kernels().blas;
  if (kernel.empty()) return {State::ok, path};
  if (const auto remedy = blas_kernel_remedy(kernel, has_ray_isa("avx2"))) return {State::slow, fmt::format("{}: {}", path, *remedy)};
  return {State::ok, fmt::format("{}, kernels for {}", path, kernel)};
}

Finding check_blas() {
  probe_torch();  // loads the BLAS
  for (const char* fast : {"libopenblas", "libmkl", "libblis"})
    if (const std::string path = loaded_library(fast); !path.empty()) return fast_blas(path);
  // Debian's OpenBLAS is a libblas.so.3 in a folder of its own.
  const std::string path = loaded_library("libblas");
  if (path.find("openblas") != std::string::npos || path.find("blis") != std::string::npos) return fast_blas(path);
  return {State::slow,
          fmt::format("{}: not OpenBLAS, which is several times faster in training: apt-get install libopenblas0-pthread, then ",
                      path.empty() ? "unknown library" : path)};
}

Finding check_torch() {
  use_one_torch_thread();
  const TorchInfo torch = probe_torch();
  if (torch.threads != 1)
    return {State::slow, fmt::format("{} uses {} threads per worker: set OMP_NUM_THREADS=1", torch.version, torch.threads)};
  return {State::ok, fmt::format("{}, one thread per worker: up to {} workers have one core each", torch.version,
                                 std::thread::hardware_concurrency())};
}

/// Has the reader program answer: it starts only where the libraries that it links are there.
Finding check_reader() {
  constexpr const char* remedy = "SOFA files cannot be read: build or install earshot_reader next to earshot";
  std::filesystem::path program;
  try {
    program = reader_program();
  } catch (const RunError& error) {
    return {State::bad, fmt::format("{}; {}", error.what(), remedy)};
  }
  try {
    if (call_isolated(program, {"check"}, program.string()) == "reads SOFA files")
      return {State::ok, fmt::format("{} reads head filters", program.string())};
  } catch (const std::exception&) {  // the same finding as another answer
  }
  return {State::bad, fmt::format("{} does not answer; {}", program.string(), remedy)};
}

/// Test data that neither a package nor the source contains.
Finding check_test_data() {
  const char* named = std::getenv("EARSHOT_DATA");
  const std::filesystem::path folder = named ? std::filesystem::path(named) : std::filesystem::path(EARSHOT_SOURCE_DIR) / "../shared/data";
  std::vector<std::string> present, absent;
  std::error_code error;
  for (const char* part : {"audio", "hrtf", "materials", "rir", "scenes"})
    (std::filesystem::is_directory(folder / part, error) ? present : absent).emplace_back(part);
  const std::string where = fmt::format("{} ({})", folder.lexically_normal().string(), named ? "EARSHOT_DATA" : "EARSHOT_DATA is not set");
  if (absent.empty()) return {State::ok, where};
  return {State::absent,
          fmt::format("{} has {}: only tests need it; those that read {} are skipped", where,
                      present.empty() ? std::string("no test data") : fmt::format("only {}", listed(present, ", ")), listed(absent, ", "))};
}

void run_doctor(const std::string& json) {
  int bad = 0;
  nlohmann::ordered_json rows = nlohmann::ordered_json::array();
  const auto print = [&](const char* check, const Finding& finding) {
    constexpr const char *words[] = {"ok", "SLOW", "none", "BAD"}, *names[] = {"ok", "slow", "absent", "bad"};
    fmt::print("{:<5} {:<10} {}\n", words[static_cast<int>(finding.state)], check, finding.text);
    bad += finding.state == State::bad;
    rows.push_back({{"what", check}, {"state", names[static_cast<int>(finding.state)]}, {"text", finding.text}});
  };
  print("earshot", {State::ok, kVersion});
  print("CPU", {State::ok, fmt::format("{}, {} cores for this process", cpu_model(), std::thread::hardware_concurrency())});
  print("vectors", check_vectors());
  print("Embree", check_embree());
  for (const Finding& finding : check_egl()) print("EGL", finding);
  print("reader", check_reader());
  print("BLAS", check_blas());
  print("libtorch", check_torch());
  print("test data", check_test_data());
  const nlohmann::ordered_json report{{"schema_version", 1}, {"findings", std::move(rows)}};
  if (!json.empty()) write_file_atomically(json, json_text(report, 2) + "\n");
  if (bad > 0) throw RunError("doctor", fmt::format("{} problems must be fixed: see the lines marked BAD above", bad));
}

}  // namespace

void add_doctor(CLI::App& app) {
  auto json = std::make_shared<std::string>();
  CLI::App* command = app.add_subcommand("doctor", "Check this machine: hardware, libraries, what is missing and how to install it");
  command->add_option("--json", *json, "Also write the findings to this JSON file")->type_name(kOutputFile);
  command->callback([json] { run_doctor(*json); });
}

}  // namespace earshot
