// The part of PeerMesh by which workers come to a run under way.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "trainer/net/join_request.h"
#include "trainer/net/peer_mesh.h"

namespace earshot {

void PeerMesh::open_meeting_point() {
  if (!survives_loss() || meeting_rank_ != config_.identity.rank || meeting_point_) return;
  meeting_point_ = std::make_unique<MeetingPoint>(
      context_, config_, security_, table_.control_endpoints[static_cast<std::size_t>(config_.identity.rank)], std::move(meeting_socket_));
}

void PeerMesh::look_at_meeting_point() {
  if (meeting_point_) meeting_point_->look(views_->current(), briefing_);
}

std::string PeerMesh::candidates() {
  if (abandoned_ || !meeting_point_) return {};
  CandidateList list;
  list.candidates = meeting_point_->ready(views_->current(), briefing_);
  return list.candidates.empty() ? std::string() : encode(list);
}

bool PeerMesh::expect(const std::string& candidates) {
  if (candidates.empty()) return false;
  CandidateList list;
  std::uint64_t joining = 0;
  const auto world_size = static_cast<std::uint32_t>(config_.identity.world_size);
  try {
    list = decode<CandidateList>(candidates);
    for (const Candidate& candidate : list.candidates) {
      const auto rank = static_cast<std::uint32_t>(candidate.rank);
      if (rank >= world_size || views_->current().has(candidate.rank) || (joining >> rank & 1) != 0)
        throw WireError("a candidate that cannot be");
      joining |= std::uint64_t{1} << rank;
    }
  } catch (const WireError& error) {
    throw RunError(fmt::format("worker {}", meeting_rank_), fmt::format("breaks the protocol: {}", error.what()));
  }
  for (const Candidate& candidate : list.candidates) {
    const auto rank = static_cast<std::size_t>(candidate.rank);
    Peer& peer = peers_[rank];
    Peer next;
    next.incarnation = candidate.incarnation;
    next.joins = true;
    next.former_endpoint = peer.joins ? peer.former_endpoint : table_.control_endpoints[rank];
    next.former_key = peer.joins ? peer.former_key : table_.public_keys[rank];
    peer = std::move(next);
    table_.control_endpoints[rank] = candidate.control_endpoint;
    table_.bulk_endpoints[rank] = candidate.bulk_endpoint;
    table_.public_keys[rank] = candidate.public_key;
    connect(candidate.rank);
  }
  views_->invite(joining);
  if (!meeting_point_) return true;

  JoinAnswer answer;
  answer.state = static_cast<std::uint8_t>(JoinState::admitted);
  answer.briefing = briefing_;
  answer.run_key = table_.run_key;
  answer.epoch = views_->current().epoch;
  answer.members = views_->current().members;
  answer.joining = joining;
  answer.meeting_rank = meeting_rank_;
  answer.control_endpoints = table_.control_endpoints;
  answer.bulk_endpoints = table_.bulk_endpoints;
  answer.public_keys = table_.public_keys;
  for (std::size_t rank = 0; rank < peers_.size(); ++rank)
    answer.incarnations.push_back(static_cast<int>(rank) == config_.identity.rank ? config_.incarnation : peers_[rank].incarnation);
  meeting_point_->admit(list.candidates, answer);
  return true;
}

void PeerMesh::invite() {
  views_->renew();
  throw Disruption{};
}

/// Of a worker that joins: asks until the members are about to let it in, and agrees with them on the view in which it is one.
void PeerMesh::join(const std::string& control_endpoint, const std::string& bulk_endpoint) {
  is_guest_ = true;
  JoinAnswer answer;
  try {
    answer = ask_for_admission(context_, config_, control_endpoint, bulk_endpoint, security_);
  } catch (...) {
    remove_listening_files();
    throw;
  }
  table_.run_key = answer.run_key;
  table_.control_endpoints = answer.control_endpoints;
  table_.bulk_endpoints = answer.bulk_endpoints;
  table_.public_keys = answer.public_keys;
  run_key_ = hash64(config_.run_id, table_.run_key);
  meeting_rank_ = answer.meeting_rank;
  briefing_ = answer.briefing;
  views_.emplace(config_.identity.rank, View{answer.epoch, answer.members}, answer.joining);
  for (std::size_t rank = 0; rank < peers_.size(); ++rank) peers_[rank].incarnation = answer.incarnations[rank];
  for (const int rank : contacts()) {
    peers_[static_cast<std::size_t>(rank)].joins = (answer.joining >> rank & 1) != 0;
    connect(rank);
  }
  set_members(views_->proposal().ranks());
  begin(0);
  try {
    regroup();
  } catch (...) {
    abandon("it has not joined");
    throw;
  }
}

/// Those of a worker that joins, which have names of their own: a rank may be started often.
void PeerMesh::remove_listening_files() const {
  if (config_.incarnation == 0 || !config_.rendezvous.starts_with("ipc://")) return;
  for (const char* traffic : {"control", "bulk"}) ::unlink(listening_address(config_, traffic).substr(6).c_str());
}

/// The view that was decided, with connections among its members.
PeerMesh::Change PeerMesh::adopt() {
  const View before = views_->current();
  views_->adopt();
  const View& now = views_->current();
  Change change;
  for (int rank = 0; rank < config_.identity.world_size; ++rank) {
    Peer& peer = peers_[static_cast<std::size_t>(rank)];
    if (before.has(rank) && !now.has(rank)) change.lost.push_back(rank);
    if (!before.has(rank) && now.has(rank)) change.joined.push_back(rank);
    if (now.has(rank)) peer.joins = false;
    if (!now.has(rank)) {
      peer.control.close();
      peer.monitor.close();
    }
    while (!peer.early.empty() && peer.early.front().header.epoch < now.epoch) peer.early.pop_front();
  }
  while (!early_bulk_.empty() && early_bulk_.front().header.epoch < now.epoch) early_bulk_.pop_front();
  set_members(now.ranks());
  sequence_ = 0;
  connect_bulk();
  if (!now.has(meeting_rank_)) meeting_rank_ = View{0, before.members & now.members}.ranks().front();
  open_meeting_point();
  regrouping_ = false;
  return change;
}

}  // namespace earshot
