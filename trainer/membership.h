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

/// How one worker comes to the same next view as the others: each proposes who is to be left, leaves out whom a proposal that it receives
/// leaves out, and proposes again; the view is decided when all of its members have proposed it.  Proposals only ever lose members, so this
/// ends.  No sockets: the owner sends proposal() to all members of current() whenever it has changed.
///
/// Only a majority of the last view goes on, or the half that holds its lowest rank: two parts of a network that is cut never both do.
class ViewAgreement {
 public:
  ViewAgreement(int rank, View first);

  [[nodiscard]] const View& current() const { return current_; }
  [[nodiscard]] const View& proposal() const { return proposal_; }
  /// Whether the next view is being agreed on.
  [[nodiscard]] bool is_open() const { return proposal_.epoch > current_.epoch; }

  /// This worker's own reasons: a peer is lost; or the same workers need new connections.
  void leave_out(int rank);
  void renew();

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
  std::array<std::optional<View>, 64> received_;  ///< the last of each worker
};

}  // namespace earshot
