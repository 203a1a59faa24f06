// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/membership.h"

#include <algorithm>
#include <bit>

#include "sim/base/errors.h"

namespace earshot {

std::vector<int> View::ranks() const {
  std::vector<int> all;
  for (int rank = 0; rank < 64; ++rank)
    if (has(rank)) all.push_back(rank);
  return all;
}

ViewAgreement::ViewAgreement(int rank, View first) : rank_(rank), current_(first), proposal_(first) {
  EARSHOT_EXPECT(rank >= 0 && rank < 64 && first.has(rank));
}

ViewAgreement::ViewAgreement(int rank, View current, std::uint64_t joining)
    : rank_(rank), current_(current), proposal_(current), joining_(joining) {
  EARSHOT_EXPECT(rank >= 0 && rank < 64 && (joining >> rank & 1) != 0 && (joining & current.members) == 0);
  open();
}

void ViewAgreement::open() {
  if (!is_open()) proposal_ = {current_.epoch + 1, current_.members | joining_};
}

void ViewAgreement::invite(std::uint64_t joining) {
  EARSHOT_EXPECT((joining & current_.members) == 0);
  if (!is_open()) joining_ = joining;
}

void ViewAgreement::leave_out(int rank) {
  EARSHOT_EXPECT(rank != rank_);
  if (is_open() && proposal_.has(rank)) ++proposal_.epoch;
  open();
  proposal_.members &= ~(std::uint64_t{1} << rank);
}

void ViewAgreement::renew() { open(); }

ViewAgreement::Effect ViewAgreement::receive(int from, const View& view) {
  // Views of the past, and the current one from a worker that has not seen it decided when it sent it.
  if (view.epoch < current_.epoch || view == current_) return Effect::none;
  if (!view.has(rank_)) return Effect::excluded;
  if (!proposal_.has(from) && (is_open() || (joining_ >> from & 1) == 0)) return Effect::none;
  const View before = proposal_;
  const bool was_open = is_open();
  open();
  View merged{std::max(proposal_.epoch, view.epoch), proposal_.members & view.members};
  // Unless it takes the other's view for a later epoch, this worker would propose two views for one.
  const bool is_others = merged == view && (!was_open || view.epoch > proposal_.epoch);
  if (merged != proposal_ && !is_others) ++merged.epoch;
  proposal_ = merged;
  received_[static_cast<std::size_t>(from)] = view;
  return proposal_ == before ? Effect::none : Effect::proposal_changed;
}

bool ViewAgreement::has_quorum() const {
  const int left = std::popcount(proposal_.members & current_.members), all = std::popcount(current_.members);
  return 2 * left > all || (2 * left == all && proposal_.has(std::countr_zero(current_.members)));
}

bool ViewAgreement::is_decided() const {
  if (!is_open() || !has_quorum()) return false;
  for (const int rank : proposal_.ranks())
    if (rank != rank_ && received_[static_cast<std::size_t>(rank)] != proposal_) return false;
  return true;
}

void ViewAgreement::adopt() {
  EARSHOT_EXPECT(is_decided());
  current_ = proposal_;
  joining_ = 0;
}

}  // namespace earshot
