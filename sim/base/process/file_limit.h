// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/resource.h>

#include <string>

namespace earshot {

/// More open files for this process than its soft limit allows (1,024 on many systems), up to the hard one; the soft limit comes back at
/// the end, and what is open then stays so.
class RaisedFileLimit {
 public:
  /// user, remedy: the part that needs so many and the advice, for the error.  Throws InputError where the hard limit is lower.
  RaisedFileLimit(int num_files, const std::string& user, const std::string& remedy);
  ~RaisedFileLimit();
  RaisedFileLimit(const RaisedFileLimit&) = delete;
  RaisedFileLimit& operator=(const RaisedFileLimit&) = delete;

 private:
  rlimit before_{};
  bool raised_ = false;
};

}  // namespace earshot
