// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

#include "sim/base/file_descriptor.h"

namespace earshot {

/// The keys that a run makes for itself where its workers meet over tcp on the loopback interface, and the user states none: every
/// process of the machine can connect there, and a run id is not secret.  The file lies in a folder of mode 0700 whose name is a function
/// of
/// user, run id and meeting point; the first worker creates it, all others read it, and the last worker of the run removes it.  The next
/// run of that name uses the file of a killed run.
class RunKey {
 public:
  /// Throws InputError where the folder is another user's or open to others, RunError where it cannot be made.
  RunKey(const std::string& run_id, const std::string& rendezvous);
  ~RunKey();
  RunKey(const RunKey&) = delete;
  RunKey& operator=(const RunKey&) = delete;

  [[nodiscard]] const std::filesystem::path& file() const { return file_; }

 private:
  std::filesystem::path folder_, file_;
  Descriptor in_use_;  ///< with a shared lock, as long as this worker lives
};

}  // namespace earshot
