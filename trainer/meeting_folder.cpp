#include "trainer/meeting_folder.h"

#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "sim/base/errors.h"

namespace earshot {

MeetingFolder::MeetingFolder(std::filesystem::path path) : path_(std::move(path)) {
  if (!path_.empty() && ::mkdir(path_.c_str(), 0700) != 0 && errno != EEXIST)
    throw RunError(path_.string(), fmt::format("cannot be created: {}", std::strerror(errno)));
}

MeetingFolder::~MeetingFolder() {
  if (!path_.empty()) ::rmdir(path_.c_str());  // refused while another worker's sockets are in it
}

}  // namespace earshot
