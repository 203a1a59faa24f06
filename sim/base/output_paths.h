// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <span>
#include <string>

namespace earshot {

/// A file or folder that a command is to write.
struct OutputPath {
  enum class Kind { file, folder };
  std::string option;  ///< as its user calls it: "--json"
  std::filesystem::path path;
  Kind kind = Kind::file;
};

/// A file or folder that the command reads.
struct InputPath {
  std::string option;  ///< as its user calls it: "--episodes", "the set of the benchmark"
  std::filesystem::path path;
  bool is_read_whole = false;  ///< a folder in which every file counts, so that nothing may be written below it
};

/// Whether both name the same place, through links, "." and "..": one need not exist yet.
bool is_same_place(const std::filesystem::path& a, const std::filesystem::path& b);
/// Whether `path` lies below `folder`, or is it.
bool is_inside(const std::filesystem::path& path, const std::filesystem::path& folder);

/// What must hold before the work starts whose results go there: each output can be written (missing parents will be made), no two are the
/// same place, none would replace an input, and none lies in a folder that is read as a whole.  Leaves nothing behind.  Throws InputError:
/// a folder where a file is meant or the reverse, a device, a place that cannot be written and why, or the two options that collide.
void check_outputs(std::span<const OutputPath> outputs, std::span<const InputPath> inputs = {});

}  // namespace earshot
