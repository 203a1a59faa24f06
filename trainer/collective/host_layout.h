// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace earshot {

/// A text that two processes have in common if they can share memory: that of the machine's start, of the namespaces of network and
/// processes (two containers on one machine count as two hosts), and of the user.  Empty where the system does not say.
std::string host_identity();

/// Workers by host, in rank order: host h has the ranks from first[h] to first[h + 1] - 1.
struct HostLayout {
  std::vector<int> first;  ///< [num_hosts() + 1]; the last is the number of workers

  [[nodiscard]] int num_hosts() const { return static_cast<int>(first.size()) - 1; }
  [[nodiscard]] int host_of(int rank) const;
  [[nodiscard]] int num_workers(int host) const;
  /// Whether some host has several workers.
  [[nodiscard]] bool shares() const { return num_hosts() < first.back(); }
};

/// By the identities of all workers, in rank order; an empty one is a host of its own.  nullopt if the ranks of some host do not follow
/// each other: sums in rank order would then go back and forth between hosts.
std::optional<HostLayout> contiguous_hosts(const std::vector<std::string>& identities);

}  // namespace earshot
