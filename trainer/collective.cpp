#include "trainer/collective.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <numeric>

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

std::string describe(const std::vector<int>& lost) {
  if (lost.empty()) return "a connection was broken and has been opened anew";
  return lost.size() == 1 ? "was lost" : "were lost";
}

}  // namespace

MembershipChange::MembershipChange(std::vector<int> lost_workers)
    : RunError(lost_workers.empty() ? "workers" : fmt::format("worker {}", fmt::join(lost_workers, ", ")), describe(lost_workers)),
      lost_(std::move(lost_workers)) {}

std::vector<int> Collective::members() const {
  std::vector<int> ranks(static_cast<std::size_t>(identity().world_size));
  std::iota(ranks.begin(), ranks.end(), 0);
  return ranks;
}

std::unique_ptr<Collective> make_single_worker() { return std::make_unique<SingleWorker>(); }

}  // namespace earshot
