// SPDX-License-Identifier: Apache-2.0
#include "policy/torch_kernels.h"

#include <ATen/Version.h>
#include <dlfcn.h>

#include <sstream>

namespace earshot {
namespace {

template <class Function>
Function* find_function(const char* name) {
  return reinterpret_cast<Function*>(::dlsym(RTLD_DEFAULT, name));
}

/// The rest of the line of libtorch's report that begins with `label`.
std::string line_after(const std::string& report, const std::string& label) {
  const std::size_t at = report.find(label);
  if (at == std::string::npos) return {};
  const std::size_t begin = at + label.size();
  return report.substr(begin, report.find('\n', begin) - begin);
}

/// dnnl_cpu_isa_t (dnnl_types.h): one bit for SSE4.1, AVX and AVX2 each, and one that all of AVX-512 share.
std::string onednn_isa() {
  const auto isa = find_function<int()>("dnnl_get_effective_cpu_isa");
  if (isa == nullptr) return {};
  const int bits = isa();
  if ((bits & 0x20) != 0) return "avx512";
  if ((bits & 0x4) != 0) return "avx2";
  if ((bits & 0x2) != 0) return "avx";
  return (bits & 0x1) != 0 ? "sse4.1" : "other";
}

/// "OpenBLAS 0.3.21" of "OpenBLAS 0.3.21 NO_LAPACK ...".
std::string first_two_words(const std::string& text) {
  std::istringstream words(text);
  std::string name, version;
  words >> name >> version;
  return name + " " + version;
}

}  // namespace

TorchKernels torch_kernels() {
  const auto core = find_function<const char*()>("openblas_get_corename");
  const auto config = find_function<const char*()>("openblas_get_config");
  return {.libtorch = line_after(at::show_config(), "CPU capability usage: "),
          .onednn = onednn_isa(),
          .blas = core != nullptr ? core() : "",
          .blas_version = config != nullptr ? first_two_words(config()) : ""};
}

}  // namespace earshot
