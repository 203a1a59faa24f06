// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/habitat/dataset_files.h"

#include <fmt/format.h>

#include <algorithm>

#include "sim/base/errors.h"
#include "sim/base/text/text_match.h"

namespace earshot {
namespace {

namespace fs = std::filesystem;

/// Names of what a folder holds; none where it cannot be read.
std::vector<fs::path> entries_of(const fs::path& folder) {
  std::vector<fs::path> entries;
  std::error_code error;
  for (fs::directory_iterator at(folder.empty() ? fs::path(".") : folder, error), end; !error && at != end; at.increment(error))
    entries.push_back(at->path().filename());
  return entries;
}

constexpr std::size_t kMaxMatches = 100'000;

bool has_wildcard(const std::string& name) { return name.find_first_of("*?") != std::string::npos; }

}  // namespace

bool ends_with_folded(const std::string& name, std::string_view end) { return fold_case(name).ends_with(fold_case(end)); }

fs::path path_within(const fs::path& root, const fs::path& base, const std::string& text, const JsonFields& fields, const char* key) {
  if (text.empty()) fields.fail(key, "is empty", "name a file");
  if (text.find('\0') != std::string::npos) fields.fail(key, "has a NUL character", "name a file");
  const fs::path written(text);
  const fs::path path = (base / written).lexically_normal();
  const fs::path below = path.lexically_relative(root.empty() ? fs::path(".") : root.lexically_normal());
  if (written.is_absolute() || below.empty() || *below.begin() == "..")
    fields.fail(key, "leads out of the folder of the data set", "copy the file into that folder, or link it there");
  return path;
}

std::vector<fs::path> find_files(const fs::path& pattern, const std::string& end) {
  std::vector<fs::path> found{fs::path()};
  for (const fs::path& part : pattern) {
    const std::string name = part.string();
    std::vector<fs::path> next;
    for (const fs::path& folder : found) {
      if (!has_wildcard(name)) {
        next.push_back(folder / part);
        continue;
      }
      for (const fs::path& entry : entries_of(folder))
        if (!entry.string().starts_with('.') && glob_match(name, entry.string())) next.push_back(folder / entry);
    }
    found = std::move(next);
    // Links to a folder above double them with each wildcard.
    if (found.size() > kMaxMatches)
      throw InputError(pattern.string(), fmt::format("matches more than {} files and folders", kMaxMatches),
                       "name the folders in 'paths' without wildcards");
  }
  std::vector<fs::path> files;
  const auto add = [&](const fs::path& path) {
    std::error_code error;
    if (ends_with_folded(path.filename().string(), end) && fs::is_regular_file(path, error)) files.push_back(path);
  };
  for (const fs::path& path : found) {
    std::error_code error;
    if (!fs::is_directory(path, error)) {
      add(path);
      continue;
    }
    for (const fs::path& entry : entries_of(path)) add((path / entry).lexically_normal());
  }
  std::sort(files.begin(), files.end());
  files.erase(std::unique(files.begin(), files.end()), files.end());
  return files;
}

}  // namespace earshot
