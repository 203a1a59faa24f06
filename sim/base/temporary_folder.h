// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

namespace earshot {

/// The folder for temporary files: $TMPDIR, or /tmp where it is not set.  Throws InputError that names the variable if it is no folder in
/// which this user can make files: no other place is taken silently.
std::filesystem::path temporary_parent();

/// A new folder that only this user may enter; it goes with everything in it.
class TemporaryFolder {
 public:
  /// In `parent`, which is there, under a name that begins so.  Throws RunError naming the folder and the reason.
  TemporaryFolder(const std::filesystem::path& parent, const char* prefix);
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace earshot
