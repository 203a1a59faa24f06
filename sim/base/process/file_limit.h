#pragma once

#include <sys/resource.h>

namespace earshot {

/// More open files for this process than its soft limit allows (1,024 on many systems), up to the hard one; the soft limit comes back at
/// the end, and what is open then stays so.
class RaisedFileLimit {
 public:
  /// Throws InputError where the hard limit is lower.
  explicit RaisedFileLimit(int num_files);
  ~RaisedFileLimit();
  RaisedFileLimit(const RaisedFileLimit&) = delete;
  RaisedFileLimit& operator=(const RaisedFileLimit&) = delete;

 private:
  rlimit before_{};
  bool raised_ = false;
};

}  // namespace earshot
