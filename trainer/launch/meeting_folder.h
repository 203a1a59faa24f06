// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "sim/base/file_descriptor.h"

namespace earshot {

/// The folder in which the workers of one host meet, mode 0700; each of them has one of these, which removes its sockets and, of the last
/// worker, the files of Gloo and the folder.  Files of a killed worker stay until the last worker of a later run of the same name.
class MeetingFolder {
 public:
  /// An empty path stands for none.  Throws RunError if it can neither be made nor is there; that it is private is checked by
  /// validate(RingConfig).
  MeetingFolder(std::filesystem::path path, int rank);
  ~MeetingFolder();
  MeetingFolder(const MeetingFolder&) = delete;
  MeetingFolder& operator=(const MeetingFolder&) = delete;

 private:
  std::filesystem::path path_;
  int rank_;
  Descriptor in_use_;  ///< the folder, with a shared lock as long as this worker lives
};

}  // namespace earshot
