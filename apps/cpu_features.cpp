#include "apps/cpu_features.h"

#include <unistd.h>

namespace earshot {

#if defined(__x86_64__)
namespace {

constexpr bool kAvx =
#if defined(__AVX__)
    true;
#else
    false;
#endif
constexpr bool kAvx2 =
#if defined(__AVX2__)
    true;
#else
    false;
#endif
constexpr bool kFma =
#if defined(__FMA__)
    true;
#else
    false;
#endif
constexpr bool kAvx512 =
#if defined(__AVX512F__)
    true;
#else
    false;
#endif

/// Runs before the constructors of the program's own globals, and for the first x86-64: the first AVX instruction would end the program
/// with a signal that tells the user nothing.
__attribute__((constructor(101), target("arch=x86-64"))) void check_cpu() {
  __builtin_cpu_init();
  const bool enough = (!kAvx || __builtin_cpu_supports("avx")) && (!kAvx2 || __builtin_cpu_supports("avx2")) &&
                      (!kFma || __builtin_cpu_supports("fma")) && (!kAvx512 || __builtin_cpu_supports("avx512f"));
  if (enough) return;
  static const char text[] =
      "earshot: this CPU lacks instructions that the program was compiled for (AVX2 and FMA by default): configure with "
      "-DEARSHOT_ARCH=x86-64\n";
  static_cast<void>(!::write(STDERR_FILENO, text, sizeof text - 1));
  ::_exit(1);
}

}  // namespace

std::vector<CpuFeature> cpu_features() {
  return {{"AVX", kAvx, __builtin_cpu_supports("avx") != 0},
          {"AVX2", kAvx2, __builtin_cpu_supports("avx2") != 0},
          {"FMA", kFma, __builtin_cpu_supports("fma") != 0},
          {"AVX-512", kAvx512, __builtin_cpu_supports("avx512f") != 0}};
}
#else
std::vector<CpuFeature> cpu_features() { return {}; }
#endif

}  // namespace earshot
