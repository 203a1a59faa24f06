// SPDX-License-Identifier: Apache-2.0
#include "sim/base/output_paths.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <map>
#include <system_error>

#include "sim/base/errors.h"
#include "sim/base/file_descriptor.h"

namespace earshot {
namespace {

namespace fs = std::filesystem;

std::string shown(const OutputPath& output) { return fmt::format("{} {}", output.option, output.path.string()); }

/// Absolute and without links as far as it exists.
fs::path real_path(const fs::path& path) {
  std::error_code error;
  fs::path real = fs::weakly_canonical(fs::absolute(path, error), error);
  if (error) real = fs::absolute(path, error).lexically_normal();
  return real.has_filename() ? real : real.parent_path();  // "folder/"
}

/// What is there has the kind that is to be written.
void check_kind(const OutputPath& output) {
  std::error_code error;
  const fs::file_status status = fs::status(output.path, error);
  if (!fs::exists(status)) return;
  if (output.kind == OutputPath::Kind::folder) {
    if (!fs::is_directory(status)) throw InputError(shown(output), "is a file, but a folder is written there", "name a folder");
    return;
  }
  if (fs::is_directory(status)) throw InputError(shown(output), "is a folder", "name a file in it");
  if (!fs::is_regular_file(status)) throw InputError(shown(output), "is not a regular file", "give a file that can be written or replaced");
}

/// Makes and removes what write_file_atomically would make first: a temporary file beside the target, or beside the first missing parent.
void check_writable(const OutputPath& output) {
  std::error_code error;
  fs::path target = real_path(output.path);
  if (output.kind == OutputPath::Kind::folder && fs::is_directory(target, error)) target /= "file";
  while (target.has_relative_path() && !fs::exists(fs::status(target.parent_path(), error))) target = target.parent_path();
  const fs::path folder = target.parent_path();
  if (!fs::is_directory(folder, error))
    throw InputError(shown(output), fmt::format("cannot be written: {} is not a folder", folder.string()), "name a file in a folder");
  fs::path probe = target;
  probe += fmt::format(".tmp{}", ::getpid());
  const Descriptor made(::open(probe.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600));
  if (made.get() < 0 && errno != EEXIST)
    throw InputError(shown(output), fmt::format("cannot be written in {}: {}", folder.string(), last_error()),
                     "name a place that can be written");
  if (made.get() >= 0) ::unlink(probe.c_str());
}

/// No two are one place, and none is a folder of another.
void check_apart(std::span<const OutputPath> outputs) {
  std::map<fs::path, const OutputPath*> placed;
  for (const OutputPath& output : outputs) {
    const auto [other, is_new] = placed.emplace(real_path(output.path), &output);
    if (!is_new)
      throw InputError(shown(*other->second), fmt::format("is also the place of {}: two outputs would replace each other", shown(output)),
                       "give each output a file of its own");
  }
  for (const auto& [path, output] : placed)
    for (fs::path folder = path.parent_path(); folder.has_relative_path(); folder = folder.parent_path())
      if (const auto other = placed.find(folder); other != placed.end() && other->second->kind == OutputPath::Kind::file)
        throw InputError(shown(*output), fmt::format("lies below {}, which is a file", shown(*other->second)),
                         "give each output a place of its own");
}

void check_against(const OutputPath& output, const InputPath& input) {
  if (is_same_place(output.path, input.path))
    throw InputError(shown(output), fmt::format("would replace what {} reads", input.option), "name another place to write");
  if (input.is_read_whole && is_inside(output.path, input.path))
    throw InputError(shown(output), fmt::format("lies in {}, which {} reads as a whole", input.path.string(), input.option),
                     "name a place outside this folder");
}

}  // namespace

bool is_same_place(const fs::path& a, const fs::path& b) {
  if (real_path(a) == real_path(b)) return true;
  std::error_code error;
  return fs::exists(a, error) && fs::exists(b, error) && fs::equivalent(a, b, error);
}

bool is_inside(const fs::path& path, const fs::path& folder) {
  const fs::path inner = real_path(path), outer = real_path(folder);
  return std::mismatch(outer.begin(), outer.end(), inner.begin(), inner.end()).first == outer.end();
}

void check_outputs(std::span<const OutputPath> outputs, std::span<const InputPath> inputs) {
  for (const OutputPath& output : outputs) {
    if (output.path.empty()) throw InputError(output.option, "names no file", "give a path, or leave the option out");
    check_kind(output);
    check_writable(output);
  }
  check_apart(outputs);
  for (const OutputPath& output : outputs)
    for (const InputPath& input : inputs) check_against(output, input);
}

}  // namespace earshot
