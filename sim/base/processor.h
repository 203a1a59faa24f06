// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#if defined(__aarch64__)
#include <sys/auxv.h>
#endif

/// The only header with code for one kind of processor: x86-64, arm64 (aarch64), and a portable form of each function for any other.
namespace earshot {

/// For a loop that waits for another thread: lets the core's other hardware thread run, and saves power.
inline void relax() {
#if defined(__x86_64__)
  __builtin_ia32_pause();
#elif defined(__aarch64__)
  asm volatile("yield");
#endif
}

/// The register that controls floating point on this thread, and its bits that flush denormals to zero, as results and as operands
/// (sim/base/denormals.h).  Of another processor there are no such bits: it computes with denormals, as reproducible, and slower.
#if defined(__x86_64__)
using FloatControl = unsigned;                            // MXCSR
inline constexpr FloatControl kFlushDenormals = 0x8040u;  // FTZ (bit 15) and DAZ (bit 6)
inline FloatControl read_float_control() { return __builtin_ia32_stmxcsr(); }
inline void write_float_control(FloatControl control) { __builtin_ia32_ldmxcsr(control); }
#elif defined(__aarch64__)
using FloatControl = std::uint64_t;                                     // FPCR
inline constexpr FloatControl kFlushDenormals = FloatControl{1} << 24;  // FZ: single and double precision, results and operands
inline FloatControl read_float_control() {
  FloatControl control;
  asm volatile("mrs %0, fpcr" : "=r"(control));
  return control;
}
inline void write_float_control(FloatControl control) { asm volatile("msr fpcr, %0" : : "r"(control) : "memory"); }
#else
using FloatControl = unsigned;
inline constexpr FloatControl kFlushDenormals = 0;
inline FloatControl read_float_control() { return 0; }
inline void write_float_control(FloatControl) {}
#endif

/// Eight floats that instructions treat alike: one register of AVX, two of arm64.
using EightFloats = float __attribute__((vector_size(32)));

/// Puts the square root of each in its place, exact as std::sqrt.  Of std::sqrt the compiler does not make one instruction, because of
/// errno.
inline void take_roots(EightFloats& values) {
#if defined(__AVX__)
  values = __builtin_ia32_sqrtps256(values);
#elif defined(__aarch64__)
  using FourFloats = float __attribute__((vector_size(16)));
  FourFloats low{values[0], values[1], values[2], values[3]}, high{values[4], values[5], values[6], values[7]};
  asm("fsqrt %0.4s, %0.4s" : "+w"(low));
  asm("fsqrt %0.4s, %0.4s" : "+w"(high));
  values = EightFloats{low[0], low[1], low[2], low[3], high[0], high[1], high[2], high[3]};
#else
  for (int lane = 0; lane < 8; ++lane) values[lane] = __builtin_sqrtf(values[lane]);
#endif
}

/// Extensions of the instruction set that loops over floats use; bit i of a set of them stands for name i.  Then the first processor of the
/// kind, which has none of them, and those that EARSHOT_ARCH uses by default.
#if defined(__x86_64__)
inline constexpr const char* kInstructionSets[] = {"SSE4.2", "AVX", "AVX2", "BMI2", "FMA", "AVX-512"};
inline constexpr const char* kFirstProcessor = "x86-64";
inline constexpr unsigned kDefaultInstructionSets = 31;  // of x86-64-v3
#elif defined(__aarch64__)
inline constexpr const char* kInstructionSets[] = {"LSE", "dot products", "SVE"};
inline constexpr const char* kFirstProcessor = "armv8-a";
inline constexpr unsigned kDefaultInstructionSets = 0;
#else
inline constexpr const char* kInstructionSets[] = {nullptr};
inline constexpr const char* kFirstProcessor = "";
inline constexpr unsigned kDefaultInstructionSets = 0;
#endif

/// Those that this file is compiled for (-march).
inline constexpr unsigned kUsedInstructionSets = 0
#if defined(__SSE4_2__)
                                                 | 1u << 0
#endif
#if defined(__AVX__)
                                                 | 1u << 1
#endif
#if defined(__AVX2__)
                                                 | 1u << 2
#endif
#if defined(__BMI2__)
                                                 | 1u << 3
#endif
#if defined(__FMA__)
                                                 | 1u << 4
#endif
#if defined(__AVX512F__)
                                                 | 1u << 5
#endif
#if defined(__ARM_FEATURE_ATOMICS)
                                                 | 1u << 0
#endif
#if defined(__ARM_FEATURE_DOTPROD)
                                                 | 1u << 1
#endif
#if defined(__ARM_FEATURE_SVE)
                                                 | 1u << 2
#endif
    ;

/// Code that says what the processor lacks must run where it lacks it: compiled for the first processor of its kind whatever -march says,
/// and calling nothing that may be compiled otherwise, not even functions of the C++ library's headers.
#if defined(__x86_64__)
#define EARSHOT_ANY_PROCESSOR __attribute__((noinline, target("arch=x86-64")))
#elif defined(__aarch64__)
#define EARSHOT_ANY_PROCESSOR __attribute__((noinline, target("arch=armv8-a")))
#else
#define EARSHOT_ANY_PROCESSOR
#endif

/// Those that this processor and its operating system have.
EARSHOT_ANY_PROCESSOR inline unsigned present_instruction_sets() {
#if defined(__x86_64__)
  __builtin_cpu_init();
  const bool avx512 = __builtin_cpu_supports("avx512f") != 0 && __builtin_cpu_supports("avx512bw") != 0 &&
                      __builtin_cpu_supports("avx512dq") != 0 && __builtin_cpu_supports("avx512vl") != 0;
  return (__builtin_cpu_supports("sse4.2") != 0 ? 1u << 0 : 0) | (__builtin_cpu_supports("avx") != 0 ? 1u << 1 : 0) |
         (__builtin_cpu_supports("avx2") != 0 ? 1u << 2 : 0) | (__builtin_cpu_supports("bmi2") != 0 ? 1u << 3 : 0) |
         (__builtin_cpu_supports("fma") != 0 ? 1u << 4 : 0) | (avx512 ? 1u << 5 : 0);
#elif defined(__aarch64__)
  const unsigned long has = ::getauxval(AT_HWCAP);
  return ((has & HWCAP_ATOMICS) != 0 ? 1u << 0 : 0) | ((has & HWCAP_ASIMDDP) != 0 ? 1u << 1 : 0) | ((has & HWCAP_SVE) != 0 ? 1u << 2 : 0);
#else
  return 0;
#endif
}

/// Writes part into text from length on, and returns the length after it; the rest is cut.
EARSHOT_ANY_PROCESSOR inline std::size_t append_part(char (&text)[256], std::size_t length, const char* part) {
  while (*part != 0 && length < sizeof text - 1) text[length++] = *part++;
  text[length] = 0;
  return length;
}

/// Whether this processor has all that this file is compiled for; where not, text gets the line to show, without its end.
EARSHOT_ANY_PROCESSOR inline bool has_used_instruction_sets(char (&text)[256]) {
  const unsigned missing = kUsedInstructionSets & ~present_instruction_sets();
  std::size_t length = append_part(text, 0, "this build of Earshot uses instructions that this processor does not have (");
  bool is_first = true;
  for (std::size_t set = 0; set < sizeof kInstructionSets / sizeof *kInstructionSets; ++set) {
    if ((missing >> set & 1u) == 0) continue;
    length = append_part(text, length, is_first ? "" : ", ");
    length = append_part(text, length, kInstructionSets[set]);
    is_first = false;
  }
  length = append_part(text, length, "); build it with -DEARSHOT_ARCH=");
  append_part(text, length, kFirstProcessor);
  return missing == 0;
}

}  // namespace earshot
