// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <dlfcn.h>
#include <gtest/gtest.h>

#include <cstddef>
#include <cstdlib>
#include <initializer_list>
#include <span>
#include <string>

#include "sim/base/compiler.h"
#include "sim/base/files.h"
#include "sim/base/processor.h"
#include "sim/rays/ray_tracer_version.h"
#include "tests/support/files/pinned_rows.h"
#include "tests/support/files/test_paths.h"

/// Absolute hashes of what each stage computes, in tests/pinned/bits.csv: a row per stage, toolchain and instruction set.
namespace earshot::pinned {

/// "embree3.13".
inline std::string ray_tracer() {
  const std::string version = ray_tracer_version();
  return "embree" + version.substr(0, version.rfind('.'));
}

/// Whose Fourier transforms the program has: "libavutil57", or "permissive" for its own.
inline std::string transforms() {
  const auto version = reinterpret_cast<unsigned (*)()>(::dlsym(RTLD_DEFAULT, "avutil_version"));
  return version ? "libavutil" + std::to_string(version() >> 16) : "permissive";
}

/// compiler, then what else a stage uses, joined by '/'.
inline std::string toolchain(std::initializer_list<std::string> libraries) {
  std::string joined = compiler_name();
  for (const std::string& library : libraries) joined += "/" + library;
  return joined;
}

/// What the machine code was compiled for.
inline std::string processor() {
  const std::string first = kFirstProcessor;
  if (first != "x86-64") return first;
  return (kUsedInstructionSets & kDefaultInstructionSets) == kDefaultInstructionSets ? "x86-64-v3" : "x86-64";
}

/// The same with the vectors that a library has chosen and that its bits depend on, as "avx2"; processors other than x86-64 have no choice.
inline std::string processor_with(const std::string& widest) {
  return std::string(kFirstProcessor) == "x86-64" ? processor() + "+" + widest : processor();
}

/// Hash over the bytes of any number of arrays, in order.
class BitHash {
 public:
  BitHash& add(std::span<const float> values) { return add(std::as_bytes(values)); }
  BitHash& add(std::span<const std::byte> bytes) {
    hash_ = hash64(bytes, hash_);
    return *this;
  }
  [[nodiscard]] std::string hex() const { return hex64(hash_); }

 private:
  std::uint64_t hash_ = 0;
};

/// Fails if the bits are not the pinned ones.  Without a row: missing_row_fails, with the row to add.
inline void expect_pinned(const Key& key, const BitHash& bits) {
#if defined(NDEBUG) && !defined(EARSHOT_SANITIZED)
  constexpr bool release_build = true;
#else
  constexpr bool release_build = false;
#endif
  const std::string file = (source_dir() / "tests/pinned/bits.csv").string();
  const std::string pinned = pinned_hash(read_file(file), key), row = row_of(key, bits.hex());
  if (!pinned.empty()) {
    EXPECT_EQ(bits.hex(), pinned)
        << "the bits of this stage have changed.  Where that is the purpose of a commit, its message says why and " << file
        << " gets the row\n"
        << row;
    return;
  }
  const std::string missing = "no pinned bits for this toolchain and instruction set; the row to add to " + file + " is\n" + row;
  if (missing_row_fails(std::getenv("CI"), std::getenv("EARSHOT_ALLOW_MISSING_PINS"), release_build))
    FAIL() << missing << "\nEARSHOT_ALLOW_MISSING_PINS=1 skips it";
  GTEST_SKIP() << missing;
}

/// Of a stage that traces rays and uses these libraries too.  The bits of one are those of every instruction set of Embree's.
inline void expect_pinned_rays(const std::string& stage, const BitHash& bits, std::initializer_list<std::string> libraries) {
  std::string toolchain_name = toolchain({ray_tracer()});
  for (const std::string& library : libraries) toolchain_name += "/" + library;
  expect_pinned({stage, toolchain_name, processor()}, bits);
}

}  // namespace earshot::pinned
