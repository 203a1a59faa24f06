// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "trainer/collective/host_layout.h"
#include "trainer/collective/sum_order.h"

namespace earshot {

/// How a sum goes round a ring of hosts so that each element is added in the order of sum_order.h.  A host's part of the buffer is the
/// segments of its ranks.  At step s of 0 to 2 H - 1 host h works on the part of host (h - s) mod H:
///   0           its own: segment k begins with the addend of rank k, the addends of the later ranks of the host follow;
///   1 to H - 1  another's: the addends of all of its ranks follow.  The host before the part's own one completes the part's first
///               segment, whose order ends there;
///   H           its own again: segment k lacks those of the host's ranks before k.  It is complete then;
///   H + 1 ...   another's, complete; the last step has nothing of first segments, which this host has completed itself.
/// After each step it goes on to the next host.  With one worker per host that is the ring over workers.
class HostRing {
 public:
  enum class Work {
    begin,  ///< addends of segment k: ranks k to the host's last
    add,    ///< onto what comes: all of the host's ranks
    end,    ///< onto what comes: the host's first rank to k - 1
    copy    ///< the received chunk is complete
  };
  /// Work of a host on one chunk.
  struct Visit {
    std::uint32_t step = 0;
    Work work = Work::begin;
    bool completes = false;            ///< the sum is complete afterwards
    bool goes_on = false;              ///< and goes on to the next host
    bool of_first_segment = false;     ///< that of the first rank of the part's host
    std::size_t first = 0, count = 0;  ///< elements
  };

  /// For `count` elements, in chunks of at most chunk_count.
  HostRing(const HostLayout& layout, std::size_t count, std::size_t chunk_count)
      : layout_(layout), count_(count), chunk_count_(chunk_count) {}

  /// All visits at a host, in the order in which it makes them; the previous host sends in the same order.
  [[nodiscard]] std::vector<Visit> visits(int host) const {
    std::vector<Visit> all;
    const int num_hosts = layout_.num_hosts(), last = 2 * num_hosts - 1;
    for (int step = 0; step <= last; ++step) {
      const auto owner = static_cast<std::size_t>((host - step % num_hosts + num_hosts) % num_hosts);
      const auto first_rank = static_cast<std::size_t>(layout_.first[owner]), end_rank = static_cast<std::size_t>(layout_.first[owner + 1]);
      for (const bool first_segment : {true, false}) {
        if (first_segment && step == last) continue;
        const std::size_t begin = start(first_segment ? first_rank : first_rank + 1);
        const std::size_t end = start(first_segment ? first_rank + 1 : end_rank);
        Visit visit;
        visit.step = static_cast<std::uint32_t>(step);
        visit.of_first_segment = first_segment;
        visit.work = work_of(step, first_segment);
        visit.completes = step >= (first_segment ? num_hosts - 1 : num_hosts);
        visit.goes_on = step < (first_segment ? last - 1 : last);
        for (visit.first = begin; visit.first < end; visit.first += visit.count) {
          visit.count = std::min(chunk_count_, end - visit.first);
          all.push_back(visit);
        }
      }
    }
    return all;
  }

 private:
  [[nodiscard]] Work work_of(int step, bool first_segment) const {
    if (step == 0) return Work::begin;
    if (step < layout_.num_hosts()) return Work::add;
    return step == layout_.num_hosts() && !first_segment ? Work::end : Work::copy;
  }
  [[nodiscard]] std::size_t start(std::size_t segment) const {
    return segment_start(count_, segment, static_cast<std::size_t>(layout_.first.back()));
  }

  HostLayout layout_;
  std::size_t count_, chunk_count_;
};

}  // namespace earshot
