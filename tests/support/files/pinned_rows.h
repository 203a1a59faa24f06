// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

/// The rows of tests/pinned/bits.csv and what becomes of a stage that has none.
namespace earshot::pinned {

/// What decides the bits of a stage beside the sources.
struct Key {
  std::string stage;
  std::string toolchain;        ///< what was compiled and linked that the stage uses, joined by '/': "g++12/embree3.13/libavutil57"
  std::string instruction_set;  ///< what the machine code was compiled for, and the widest vectors that were used: "x86-64-v3+avx2"
};

inline std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> parts;
  std::istringstream stream(text);
  for (std::string part; std::getline(stream, part, separator);) parts.push_back(part);
  return parts;
}

/// The hash of the row "stage,toolchain,instruction set,hash" with this key; empty if there is none.  Toolchains that give the same bits
/// share a row, separated by '|'.  Throws std::runtime_error for a row without four columns and for a key that two rows have.
inline std::string pinned_hash(std::string_view csv, const Key& key) {
  std::string found;
  std::istringstream rows{std::string(csv)};
  for (std::string row; std::getline(rows, row);) {
    const std::vector<std::string> columns = split(row, ',');
    if (columns.size() != 4) throw std::runtime_error("not stage,toolchain,instruction set,hash: " + row);
    const std::vector<std::string> toolchains = split(columns[1], '|');
    if (columns[0] != key.stage || columns[2] != key.instruction_set) continue;
    if (std::find(toolchains.begin(), toolchains.end(), key.toolchain) == toolchains.end()) continue;
    if (!found.empty()) throw std::runtime_error("two rows of one key: " + row);
    found = columns[3];
  }
  return found;
}

inline std::string row_of(const Key& key, const std::string& hash) {
  return key.stage + "," + key.toolchain + "," + key.instruction_set + "," + hash;
}

/// Whether a stage without a row is a failure, not a skipped test.  ci, allow: the environment variables CI and
/// EARSHOT_ALLOW_MISSING_PINS, null if unset.  Pins are of release builds: debug and sanitizer builds, of another compiler, are compared
/// where a row fits them and need none.
inline bool missing_row_fails(const char* ci, const char* allow, bool release_build) {
  const auto is_set = [](const char* value) { return value != nullptr && *value != 0; };
  return release_build && is_set(ci) && (allow == nullptr || std::string_view(allow) != "1");
}

}  // namespace earshot::pinned
