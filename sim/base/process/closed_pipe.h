// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <csignal>

namespace earshot {

/// For commands whose work is worth more than their output: where no reader is left (`| head`, or Ctrl-C that has ended `tee`
/// first), a write to it fails and the process goes on.  Programs that are started inherit this.
inline void outlive_closed_pipes() { std::signal(SIGPIPE, SIG_IGN); }

}  // namespace earshot
