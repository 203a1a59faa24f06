// SPDX-License-Identifier: Apache-2.0
#include "trainer/collective/host_layout.h"

#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <set>

namespace earshot {

std::string host_identity() {
  std::string boot;
  std::getline(std::ifstream("/proc/sys/kernel/random/boot_id"), boot);
  struct stat network {
  }, processes{};
  if (boot.empty() || ::stat("/proc/self/ns/net", &network) != 0 || ::stat("/proc/self/ns/pid", &processes) != 0) return {};
  return fmt::format("{} {} {} {}", boot, network.st_ino, processes.st_ino, ::geteuid());
}

int HostLayout::host_of(int rank) const { return static_cast<int>(std::ranges::upper_bound(first, rank) - first.begin()) - 1; }

int HostLayout::num_workers(int host) const { return first[static_cast<std::size_t>(host) + 1] - first[static_cast<std::size_t>(host)]; }

std::optional<HostLayout> contiguous_hosts(const std::vector<std::string>& identities) {
  HostLayout layout;
  std::set<std::string> seen;
  for (std::size_t rank = 0; rank < identities.size(); ++rank) {
    const std::string& identity = identities[rank];
    if (rank > 0 && !identity.empty() && identity == identities[rank - 1]) continue;
    if (!identity.empty() && !seen.insert(identity).second) return std::nullopt;
    layout.first.push_back(static_cast<int>(rank));
  }
  layout.first.push_back(static_cast<int>(identities.size()));
  return layout;
}

}  // namespace earshot
