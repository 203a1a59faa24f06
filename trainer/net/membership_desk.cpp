// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/membership_desk.h"

#include <fmt/format.h>

#include <algorithm>
#include <span>
#include <string>
#include <utility>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/listed.h"
#include "sim/base/text/log.h"

namespace earshot {
namespace {

constexpr double kJoinPatience_s = 5;               // with a worker that was told that it may join
constexpr std::chrono::seconds kGuestPatience(10);  // of that worker: longer, so that it is the members who decide
constexpr std::chrono::seconds kNoticeInterval(1);

FrameHeader view_header(const ViewMessage& message, const std::string& text) {
  FrameHeader header;
  header.operation = Operation::view;
  header.epoch = message.epoch;
  header.total = text.size();
  return header;
}

}  // namespace

void AddressBook::set(const JoinAnswer& answer) {
  table_.run_key = answer.run_key;
  table_.control_endpoints = answer.control_endpoints;
  table_.bulk_endpoints = answer.bulk_endpoints;
  table_.public_keys = answer.public_keys;
  for (std::size_t rank = 0; rank < entries_.size(); ++rank) entries_[rank].incarnation = answer.incarnations[rank];
}

void AddressBook::replace(const Candidate& candidate, bool was_member) {
  const auto rank = static_cast<std::size_t>(candidate.rank);
  entries_[rank] = {candidate.incarnation, was_member ? control(candidate.rank) : entries_[rank].former, {}};
  table_.control_endpoints[rank] = candidate.control_endpoint;
  table_.bulk_endpoints[rank] = candidate.bulk_endpoint;
  table_.public_keys[rank] = candidate.public_key;
}

PeerAddress AddressBook::control(int rank) const {
  const auto index = static_cast<std::size_t>(rank);
  return {table_.control_endpoints[index], table_.public_keys[index]};
}

PeerAddress AddressBook::bulk(int rank) const {
  const auto index = static_cast<std::size_t>(rank);
  return {table_.bulk_endpoints[index], table_.public_keys[index]};
}

bool AddressBook::is_current(PeerSender sender) const {
  return entries_[static_cast<std::size_t>(sender.rank)].incarnation == sender.incarnation;
}

std::optional<PeerAddress> AddressBook::take_notice_address(PeerSender sender) {
  const auto now = std::chrono::steady_clock::now();
  Entry& entry = entries_[static_cast<std::size_t>(sender.rank)];
  if (now - entry.notified_at < kNoticeInterval) return std::nullopt;
  entry.notified_at = now;
  PeerAddress address = is_current(sender) ? control(sender.rank) : entry.former;
  if (address.endpoint.empty()) return std::nullopt;  // of a start that this worker has never known
  return address;
}

JoinAnswer AddressBook::listing(std::uint32_t incarnation) const {
  JoinAnswer answer;
  answer.run_key = table_.run_key;
  answer.control_endpoints = table_.control_endpoints;
  answer.bulk_endpoints = table_.bulk_endpoints;
  answer.public_keys = table_.public_keys;
  for (const Entry& entry : entries_) answer.incarnations.push_back(entry.incarnation);
  answer.incarnations[static_cast<std::size_t>(own_identity_.rank)] = incarnation;
  return answer;
}

MembershipDesk::MembershipDesk(const RingConfig& config, PeerLinks& links, Liveness& liveness)
    : config_(config), links_(links), liveness_(liveness), book_(config.identity) {}

void MembershipDesk::start(PeerTable table) {
  book_.set(std::move(table));
  links_.set_run_key(hash64(config_.run_id, book_.run_key()));
  const int world_size = config_.identity.world_size;
  views_.emplace(config_.identity.rank, View{0, world_size == 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << world_size) - 1});
  for (const int rank : contacts()) connect(rank);
  set_members(views_->current().ranks());
}

void MembershipDesk::start_as_guest(const JoinAnswer& answer) {
  is_guest_ = true;
  book_.set(answer);
  links_.set_run_key(hash64(config_.run_id, book_.run_key()));
  views_.emplace(config_.identity.rank, View{answer.epoch, answer.members}, answer.joining);
  for (const int rank : contacts()) {
    if ((answer.joining >> rank & 1) != 0) newcomers_.insert(rank);
    connect(rank);
  }
  set_members(views_->proposal().ranks());
}

void MembershipDesk::connect(int rank) {
  links_.connect(rank, book_.control(rank));
  liveness_.greet(rank);
}

void MembershipDesk::set_members(std::vector<int> ranks) {
  members_ = std::move(ranks);
  identity_ = {place_of(config_.identity.rank), static_cast<int>(members_.size())};
}

int MembershipDesk::place_of(int rank) const { return static_cast<int>(std::ranges::find(members_, rank) - members_.begin()); }

std::vector<int> MembershipDesk::contacts() const {
  std::vector<int> ranks;
  for (int rank = 0; rank < config_.identity.world_size; ++rank)
    if (rank != config_.identity.rank && views_->knows(rank)) ranks.push_back(rank);
  return ranks;
}

FrameHeader MembershipDesk::stamped(FrameHeader header) const {
  header.sequence = liveness_.call();
  header.epoch = views_->current().epoch;
  return header;
}

PeerLinks::Origin MembershipDesk::admit_or_notify(PeerSender sender) {
  if (views_->knows(sender.rank) && book_.is_current(sender)) return PeerLinks::Origin::known;
  if (const auto address = book_.take_notice_address(sender)) {
    ViewMessage message;
    message.epoch = views_->current().epoch;
    message.members = views_->current().members & ~(std::uint64_t{1} << sender.rank);  // not the rank's of its next start
    const std::string text = encode(message);
    links_.send_notice(*address, view_header(message, text), std::as_bytes(std::span(text)));
  }
  return PeerLinks::Origin::late;
}

/// A lost peer is the end of the run, or of this view.
void MembershipDesk::lose(int rank, const std::string& problem) {
  if (!config_.survives_loss()) throw WorldLost(worker_name(rank), problem);
  log_warning(fmt::format("worker {}: {}", rank, problem));
  views_->leave_out(rank);
}

void MembershipDesk::check(const std::vector<int>& awaited) {
  for (const int rank : members_) {
    if (const auto& num_calls = liveness_.finished_after(rank)) {
      // It has done its part of this call or never will; its messages may still be in transit.
      if (*num_calls < liveness_.call()) throw liveness_.has_left(rank);
    } else if (liveness_.is_gone(rank)) {
      lose(rank, fmt::format("stopped responding in collective call {}: the process was killed, crashed or hangs", liveness_.call()));
    }
  }
  for (const int rank : awaited)
    if (rank != config_.identity.rank && liveness_.is_silent(rank)) lose(rank, liveness_.describe_silence());
}

void MembershipDesk::take_view(const PeerFrame& frame) {
  try {
    if (!config_.survives_loss())
      throw WireError("membership view in a run with network.on_loss=stop; set the same network.on_loss in all workers");
    const auto message = decode<ViewMessage>(frame.payload.to_string_view());
    const View view{message.epoch, message.members};
    // A worker that joins may have proposed before this one knew of it; and one that proposes now hears so again.
    if (is_guest_ && is_regrouping_) uninformed_.insert(frame.from);
    if (views_->receive(frame.from, view) != ViewAgreement::Effect::excluded) return;
    left_out_ = true;
    if (is_guest_) throw LeftOut(worker_name(config_.identity.rank), "was not admitted because another membership change took precedence");
    throw LeftOut(worker_name(config_.identity.rank), fmt::format("was excluded from the run after a pause: workers {} continue without "
                                                                  "it; its later work is lost, and there is nothing to resume",
                                                                  listed(view.ranks(), ", ")));
  } catch (const WireError& error) {
    throw protocol_breach(frame.from, error);
  }
}

void MembershipDesk::open_agreement() {
  is_regrouping_ = true;
  agreement_began_ = Liveness::Clock::now();
  sent_ = {};
}

bool MembershipDesk::has_quorum() {
  drop_lost_peers();
  return views_->has_quorum();
}

void MembershipDesk::propose() {
  if (!has_quorum()) {
    left_out_ = true;
    throw LeftOut(worker_name(config_.identity.rank), fmt::format("reaches only worker {} of {}, so it stops here: the other workers may "
                                                                  "continue without them; if they did not, continue with --resume",
                                                                  listed(views_->proposal().ranks(), ", "), listed(members_, ", ")));
  }
  if (sent_ != views_->proposal())
    for (const int rank : contacts()) uninformed_.insert(rank);
  sent_ = views_->proposal();
  send_proposals();
}

void MembershipDesk::drop_lost_peers() {
  using Seconds = std::chrono::duration<double>;
  for (const int rank : views_->proposal().ranks()) {
    const bool joins = newcomers_.contains(rank);
    // A worker that joins cannot cost a member its place: who does not reach all others gives up.
    if (rank == config_.identity.rank || (is_guest_ && !joins)) continue;
    const double timeout_s = config_.network.progress_timeout_s;
    const Seconds patience(joins ? std::min(kJoinPatience_s, timeout_s) : timeout_s);
    if (!liveness_.finished_after(rank) && liveness_.silence(rank, agreement_began_) < patience && !liveness_.is_gone(rank)) continue;
    log_warning(fmt::format("worker {}: {}", rank, joins ? "did not join in time, or was lost again" : "was lost as well"));
    views_->leave_out(rank);
  }
}

/// To those that the proposal leaves out it goes once, so that they know when they wake.
void MembershipDesk::send_proposals() {
  ViewMessage message;
  message.epoch = views_->proposal().epoch;
  message.members = views_->proposal().members;
  const std::string text = encode(message);
  const FrameHeader header = stamped(view_header(message, text));
  for (const int rank : contacts()) {
    if (!uninformed_.contains(rank)) continue;
    const bool is_sent = links_.is_connected(rank) && links_.send(rank, header, std::as_bytes(std::span(text)));
    if (is_sent || !views_->proposal().has(rank)) uninformed_.erase(rank);
  }
}

bool MembershipDesk::is_settled() {
  if (is_guest_ && Liveness::Clock::now() - agreement_began_ >= kGuestPatience) {
    left_out_ = true;
    throw LeftOut(worker_name(config_.identity.rank),
                  fmt::format("was not admitted by worker {}", listed(views_->current().ranks(), ", ")));
  }
  const bool all_know = std::ranges::none_of(uninformed_, [&](int rank) { return sent_.has(rank); });
  return all_know && views_->is_decided();
}

MembershipDesk::Change MembershipDesk::adopt() {
  const View old_view = views_->current();
  views_->adopt();
  const View& new_view = views_->current();
  Change change;
  for (int rank = 0; rank < config_.identity.world_size; ++rank) {
    if (old_view.has(rank) && !new_view.has(rank)) change.lost.push_back(rank);
    if (!old_view.has(rank) && new_view.has(rank)) change.joined.push_back(rank);
    if (new_view.has(rank))
      newcomers_.erase(rank);
    else
      links_.disconnect(rank);
  }
  links_.kept().drop_before(new_view.epoch);
  set_members(new_view.ranks());
  liveness_.set_call(0);
  is_regrouping_ = false;
  return change;
}

void MembershipDesk::expect(const std::vector<Candidate>& candidates) {
  std::uint64_t joining = 0;
  for (const Candidate& candidate : candidates) {
    book_.replace(candidate, !newcomers_.contains(candidate.rank));
    newcomers_.insert(candidate.rank);
    uninformed_.erase(candidate.rank);
    connect(candidate.rank);
    joining |= std::uint64_t{1} << candidate.rank;
  }
  views_->invite(joining);
}

}  // namespace earshot
