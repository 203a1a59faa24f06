#pragma once

#include <gtest/gtest.h>

#include <cstddef>
#include <fstream>
#include <span>
#include <sstream>
#include <string>

#include "sim/base/files.h"
#include "tests/support/test_paths.h"

/// Absolute hashes of what each stage computes, in tests/pinned/bits.csv: one row per stage and instruction set.
namespace earshot::pinned {

/// What decides the bits beside the sources: the compiler and the architecture that our code is compiled for, and the widest vectors that
/// the libraries (Embree, BLAS, FFT) choose from on this processor.  Rows without a compiler's name are those of g++.
inline std::string instruction_set() {
#if defined(__clang__)
  const std::string compiler = "+clang";
#else
  const std::string compiler;
#endif
#if defined(__x86_64__) && defined(__AVX2__)
  return (__builtin_cpu_supports("avx512f") != 0 ? "x86-64-v3+avx512" : "x86-64-v3") + compiler;
#elif defined(__x86_64__)
  return "x86-64" + compiler;
#elif defined(__aarch64__)
  return "aarch64" + compiler;
#else
  return "other" + compiler;
#endif
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

/// The hash that `file` (rows "stage,instruction set,hash") has for a stage; empty if there is no row.
inline std::string pinned_hash(const std::string& file, const std::string& stage, const std::string& set) {
  std::istringstream rows(read_file(file));
  for (std::string row; std::getline(rows, row);) {
    if (row.starts_with(stage + "," + set + ",")) return row.substr(stage.size() + set.size() + 2);
  }
  return {};
}

/// Fails if the bits of a stage are not the pinned ones.  A processor without a row of its own is skipped, with the row to add.
/// library: what else decides the bits of this stage, appended to the instruction set.
inline void expect_pinned(const std::string& stage, const BitHash& bits, const std::string& library = {}) {
  const std::string file = (source_dir() / "tests/pinned/bits.csv").string(), set = instruction_set() + library;
  const std::string pinned = pinned_hash(file, stage, set), row = stage + "," + set + "," + bits.hex();
  if (pinned.empty()) GTEST_SKIP() << "no pinned bits for this instruction set; the row for " << file << " is\n" << row;
  EXPECT_EQ(bits.hex(), pinned) << "the bits of this stage have changed.  Where that is the purpose of a commit, its message says why and "
                                << file << " gets the row\n"
                                << row;
}

}  // namespace earshot::pinned
