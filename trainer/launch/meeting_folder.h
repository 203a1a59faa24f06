// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

namespace earshot {

/// The folder in which the workers of one host meet, mode 0700; each of them has one of these, which removes its sockets and, of the last
/// worker, the folder.  Files of a killed worker stay, and the next run of the same name takes them over.
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
};

}  // namespace earshot
