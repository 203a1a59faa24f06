// SPDX-License-Identifier: Apache-2.0
#include "sim/base/process/file_limit.h"

#include <fmt/format.h>

#include <cerrno>
#include <cstring>

#include "sim/base/errors.h"

namespace earshot {

RaisedFileLimit::RaisedFileLimit(int num_files, const std::string& user, const std::string& remedy) {
  if (::getrlimit(RLIMIT_NOFILE, &before_) != 0) throw RunError("open files", std::strerror(errno));
  const auto wanted = static_cast<rlim_t>(num_files);
  if (before_.rlim_cur == RLIM_INFINITY || before_.rlim_cur >= wanted) return;
  if (before_.rlim_max != RLIM_INFINITY && before_.rlim_max < wanted)
    throw InputError("open files (ulimit -Hn)", fmt::format("at most {} are allowed here, but {} needs {}", before_.rlim_max, user, wanted),
                     remedy);
  rlimit raised = before_;
  raised.rlim_cur = wanted;
  if (::setrlimit(RLIMIT_NOFILE, &raised) != 0) throw RunError("open files", std::strerror(errno));
  raised_ = true;
}

RaisedFileLimit::~RaisedFileLimit() {
  if (raised_) ::setrlimit(RLIMIT_NOFILE, &before_);
}

}  // namespace earshot
