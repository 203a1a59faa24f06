// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string_view>

namespace earshot {

/// A file that appears whole under its name or not at all, written piece by piece beside it as PATH.part.  Of two processes or threads that
/// write the same file, the second waits until the first is done or dead; what a killed one left behind is replaced.
class PartFile {
 public:
  /// Creates missing folders.  Throws RunError, as all of this class do.
  explicit PartFile(std::filesystem::path path);
  ~PartFile();  ///< removes what was not kept
  PartFile(const PartFile&) = delete;
  PartFile& operator=(const PartFile&) = delete;

  void append(std::string_view bytes);
  /// Waits until the bytes are on the disk.
  void flush();
  /// Gives the file its name, replacing another.  Nothing may be appended then.
  void keep();

 private:
  std::filesystem::path path_, part_;
  int descriptor_ = -1;
  bool is_kept_ = false;
};

}  // namespace earshot
