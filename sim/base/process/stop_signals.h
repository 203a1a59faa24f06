// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>

namespace earshot {

/// While it lives, SIGTERM, SIGINT, SIGHUP and SIGUSR1 ask for a graceful stop instead of ending the process (SIGHUP only where it was not
/// ignored, as under nohup); the old handlers come back at its end.  One at a time.
class StopSignals {
 public:
  StopSignals();
  ~StopSignals();
  StopSignals(const StopSignals&) = delete;
  StopSignals& operator=(const StopSignals&) = delete;

  /// Has one come since the last of these objects was made?
  static bool received() { return signal() != 0; }
  /// The first that has come since then; 0: none.
  static int signal();

 private:
  std::array<void (*)(int), 4> previous_{};
};

}  // namespace earshot
