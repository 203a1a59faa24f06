// SPDX-License-Identifier: Apache-2.0
#include "trainer/collective/collective.h"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>

#include "sim/base/text/listed.h"

namespace earshot {
namespace {

class SingleWorker : public Collective {
 public:
  [[nodiscard]] WorkerIdentity identity() const override { return {}; }
  void all_reduce_sum(std::span<float>) override {}
  void all_reduce_sum(std::span<double>) override {}
  void broadcast(std::span<std::byte>) override {}
  void barrier() override {}
  std::vector<std::string> all_gather(const std::string& bytes) override { return {bytes}; }
};

std::string subject_of(const std::vector<int>& lost, const std::vector<int>& joined) {
  if (lost.empty() && joined.empty()) return "workers";
  return fmt::format("worker {}", listed(lost.empty() ? joined : lost, ", "));
}

std::string describe(const std::vector<int>& lost, const std::vector<int>& joined) {
  if (lost.empty() && joined.empty()) return "a broken connection was opened again";
  if (lost.empty()) return joined.size() == 1 ? "has joined" : "have joined";
  return lost.size() == 1 ? "was lost" : "were lost";
}

}  // namespace

MembershipChange::MembershipChange(std::vector<int> lost_workers, std::vector<int> joined_workers)
    : RunError(subject_of(lost_workers, joined_workers), describe(lost_workers, joined_workers)),
      lost_(std::move(lost_workers)),
      joined_(std::move(joined_workers)) {}

std::string Collective::hand_over(int from, const std::vector<int>& to, const std::string& bytes) {
  const int rank = identity().rank;
  const auto parts = all_gather(rank == from ? bytes : std::string());
  return std::ranges::find(to, rank) == to.end() ? std::string() : parts[static_cast<std::size_t>(from)];
}

std::vector<int> Collective::members() const {
  std::vector<int> ranks(static_cast<std::size_t>(identity().world_size));
  std::iota(ranks.begin(), ranks.end(), 0);
  return ranks;
}

std::unique_ptr<Collective> make_single_worker() { return std::make_unique<SingleWorker>(); }

}  // namespace earshot
