// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

namespace earshot {

/// The workers of a run at one time: bit r of members stands for the one that began as rank r.  Each change has a later epoch.
struct View {
  std::uint32_t epoch = 0;
  std::uint64_t members = 0;
  friend bool operator==(const View&, const View&) = default;

  [[nodiscard]] bool has(int rank) const { return (members >> rank & 1) != 0; }
  [[nodiscard]] std::vector<int> ranks() const;
};

/// Agreement of the workers on the next view: each proposes the remaining members, removes those that a received proposal leaves out, and
/// proposes again; the view is decided when all of its members have proposed it.  Proposals only ever lose members, so this
/// ends.  A worker proposes each epoch for one set of members, and two sets that are decided have a worker in common: no epoch has two
/// views.  No sockets: the owner sends proposal() to all of current() and proposal() whenever it has changed.
///
/// Workers join by a proposal that begins with more members than the last view had.  They propose like the others, so that a view with them
/// is decided only once they reach all and all reach them.  Whoever does not know of them leaves them out: a change that crosses comes
/// first.
///
/// Only a majority of the last view goes on, or the half that holds its lowest rank: two parts of a network that is cut never both do.
class ViewAgreement {
 public:
  ViewAgreement(int rank, View first);
  /// Of a worker that joins the members of `current` together with `joining`, of which it is one.
  ViewAgreement(int rank, View current, std::uint64_t joining);

  [[nodiscard]] const View& current() const { return current_; }
  [[nodiscard]] const View& proposal() const { return proposal_; }
  /// Whether the next view is being agreed on.
  [[nodiscard]] bool is_open() const { return proposal_.epoch > current_.epoch; }

  /// This worker's own reasons: a peer is lost; or the same workers need new connections.
  void leave_out(int rank);
  void renew();
  /// The next proposal begins with these workers as well (bit r: rank r), none of which is a member.  All members have been told the same.
  void invite(std::uint64_t joining);
  /// Whether messages of that worker belong here.
  [[nodiscard]] bool knows(int rank) const { return ((current_.members | proposal_.members | joining_) >> rank & 1) != 0; }

  enum class Effect { none, proposal_changed, excluded };
  /// Another worker proposes a view.  excluded: one without this worker.
  Effect receive(int from, const View& view);

  [[nodiscard]] bool has_quorum() const;
  [[nodiscard]] bool is_decided() const;
  /// Once it is decided and all members of the proposal have been sent it.
  void adopt();

 private:
  void open();

  int rank_;
  View current_, proposal_;
  std::uint64_t joining_ = 0;
  std::array<std::optional<View>, 64> received_;  ///< the last of each worker
};

}  // namespace earshot
