// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>

#include "sim/base/temporary_folder.h"

namespace earshot {

/// The variables in which our own spawn says a worker's place, and which a user may set by hand (docs/howto/hosts.md).
inline constexpr const char *kRankName = "EARSHOT_RANK", *kWorldSizeName = "EARSHOT_WORLD_SIZE", *kRendezvousName = "EARSHOT_RENDEZVOUS",
                            *kRunIdName = "EARSHOT_RUN_ID";

/// The folder of temporary files, or /tmp where its name is too long for that of a socket in it, which has 107 characters at most.  Throws
/// as temporary_parent() does.
inline std::filesystem::path parent_of_sockets() {
  constexpr std::size_t kMaxLength = 60;
  const std::filesystem::path parent = temporary_parent();
  return parent.string().size() > kMaxLength ? "/tmp" : parent;
}

}  // namespace earshot
