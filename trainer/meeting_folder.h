#pragma once

#include <filesystem>

namespace earshot {

/// The folder in which the workers of one host meet, mode 0700; each of them has one of these and the last one removes it.  What a killed
/// worker left in it stays, and is taken over by the next run of the same name.
class MeetingFolder {
 public:
  /// An empty path stands for none.  Throws RunError if it can neither be made nor is there; that it is private is checked by
  /// validate(RingConfig).
  explicit MeetingFolder(std::filesystem::path path);
  ~MeetingFolder();
  MeetingFolder(const MeetingFolder&) = delete;
  MeetingFolder& operator=(const MeetingFolder&) = delete;

 private:
  std::filesystem::path path_;
};

}  // namespace earshot
