// SPDX-License-Identifier: Apache-2.0
#include "trainer/launch/run_key.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "trainer/launch/worker_names.h"
#include "trainer/net/curve_keys.h"

namespace earshot {
namespace {

constexpr int kMaxTries = 100;  // each fails where the last worker of another run removes the file meanwhile

void make_private_folder(const std::filesystem::path& folder) {
  if (::mkdir(folder.c_str(), 0700) != 0 && errno != EEXIST) throw RunError(folder.string(), "cannot be created: " + last_error());
  struct stat status {};
  if (::lstat(folder.c_str(), &status) != 0) return;  // removed by the last worker of another run
  if (!S_ISDIR(status.st_mode) || status.st_uid != ::geteuid() || (status.st_mode & 0077) != 0)
    throw InputError(folder.string(), "is not a folder of this user alone, and the key of the run is to lie there",
                     "remove it, or give the run keys by network.curve_key_file");
}

/// Whole under its name or not there: others read it at any time.
void make_keys(const std::filesystem::path& file) {
  const std::filesystem::path temporary = fmt::format("{}.{}", file.string(), ::getpid());
  ::unlink(temporary.c_str());  // of a killed process with this number
  write_curve_keys(temporary, make_curve_keys());
  ::link(temporary.c_str(), file.c_str());  // where another worker came first, its keys are taken
  ::unlink(temporary.c_str());
}

}  // namespace

RunKey::RunKey(const std::string& run_id, const std::string& rendezvous)
    : folder_(parent_of_sockets() / fmt::format("earshot-{}-{}", ::geteuid(), hex64(hash64(run_id + "\n" + rendezvous, 2)))),
      file_(folder_ / "curve.keys") {
  for (int tries = 0; tries < kMaxTries; ++tries) {
    make_private_folder(folder_);
    if (::access(file_.c_str(), F_OK) != 0) try {
        make_keys(file_);
      } catch (const RunError&) {
        if (std::filesystem::exists(folder_)) throw;
        continue;
      }
    Descriptor file(::open(file_.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW));
    struct stat opened {
    }, named{};
    if (file.get() < 0 || ::flock(file.get(), LOCK_SH) != 0) continue;
    if (::fstat(file.get(), &opened) != 0 || ::stat(file_.c_str(), &named) != 0 || opened.st_ino != named.st_ino) continue;
    in_use_ = std::move(file);
    return;
  }
  throw RunError(file_.string(), "cannot be made and kept: " + last_error());
}

RunKey::~RunKey() {
  if (::flock(in_use_.get(), LOCK_EX | LOCK_NB) != 0) return;  // another worker lives
  ::unlink(file_.c_str());
  ::rmdir(folder_.c_str());
}

}  // namespace earshot
