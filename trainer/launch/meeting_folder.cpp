// SPDX-License-Identifier: Apache-2.0
#include "trainer/launch/meeting_folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "sim/base/errors.h"

namespace earshot {

MeetingFolder::MeetingFolder(std::filesystem::path path, int rank) : path_(std::move(path)), rank_(rank) {
  if (path_.empty()) return;
  if (::mkdir(path_.c_str(), 0700) != 0 && errno != EEXIST)
    throw RunError(path_.string(), fmt::format("cannot be created: {}", std::strerror(errno)));
  in_use_ = Descriptor(::open(path_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (in_use_.get() >= 0) ::flock(in_use_.get(), LOCK_SH | LOCK_NB);  // for the removal of files only
}

MeetingFolder::~MeetingFolder() {
  if (path_.empty()) return;
  // libzmq leaves the files of its sockets where they are.
  for (const char* traffic : {"control", "bulk"}) ::unlink((path_ / fmt::format("meet.{}.{}", rank_, traffic)).c_str());
  std::error_code ignored;
  // Those of all starts, once no worker is there any more.
  if (in_use_.get() >= 0 && ::flock(in_use_.get(), LOCK_EX | LOCK_NB) == 0)
    for (const auto& entry : std::filesystem::directory_iterator(path_, ignored))
      if (entry.path().filename().string().starts_with("meet.gloo.")) ::unlink(entry.path().c_str());
  // Of whoever listened last for workers that join, once no worker is there any more.
  const auto files = std::filesystem::directory_iterator(path_, ignored);
  if (rank_ == 0 || (!ignored && std::distance(begin(files), end(files)) == 1)) ::unlink((path_ / "meet").c_str());
  ::rmdir(path_.c_str());  // refused while another worker's sockets are in it
}

}  // namespace earshot
