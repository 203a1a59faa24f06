// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/admission_desk.h"

#include <algorithm>
#include <utility>

#include "sim/base/errors.h"
#include "trainer/net/join_request.h"
#include "trainer/net/meeting_sockets.h"

namespace earshot {

AdmissionDesk::AdmissionDesk(const RingConfig& config, PeerLinks& links, MembershipDesk& desk)
    : config_(config), links_(links), desk_(desk) {}

JoinAnswer AdmissionDesk::ask() {
  using enum PeerLinks::Plane;
  try {
    JoinAnswer answer = ask_for_admission(links_.context(), config_, links_.endpoint(control), links_.endpoint(bulk), links_.security());
    meeting_rank_ = answer.meeting_rank;
    briefing_ = answer.briefing;
    return answer;
  } catch (...) {
    links_.remove_listening_files();
    throw;
  }
}

void AdmissionDesk::listen(zmq::socket_t socket) {
  if (!config_.survives_loss() || meeting_rank_ != config_.identity.rank || meeting_point_) return;
  meeting_point_ = std::make_unique<MeetingPoint>(links_.context(), config_, links_.security(),
                                                  desk_.book().control(config_.identity.rank).endpoint, std::move(socket));
}

void AdmissionDesk::follow(const MembershipDesk::Change& change) {
  const auto& members = desk_.members();
  if (!desk_.view().has(meeting_rank_))
    meeting_rank_ = *std::ranges::find_if(members, [&](int rank) { return std::ranges::find(change.joined, rank) == change.joined.end(); });
  listen({});
}

void AdmissionDesk::look() {
  if (meeting_point_) meeting_point_->look(desk_.view(), briefing_);
}

std::string AdmissionDesk::candidates() {
  if (!meeting_point_) return {};
  CandidateList list;
  list.candidates = meeting_point_->ready(desk_.view(), briefing_);
  return list.candidates.empty() ? std::string() : encode(list);
}

CandidateList AdmissionDesk::decode_candidates(const std::string& text) const {
  try {
    auto list = decode<CandidateList>(text);
    check(list, desk_.view(), config_.identity.world_size);
    return list;
  } catch (const WireError& error) {
    throw protocol_breach(meeting_rank_, error);
  }
}

bool AdmissionDesk::expect(const std::string& candidates) {
  if (candidates.empty()) return false;
  const CandidateList list = decode_candidates(candidates);
  desk_.expect(list.candidates);
  if (meeting_point_) admit(list);
  return true;
}

void AdmissionDesk::invite() {
  desk_.renew();
  throw MembershipDesk::Disruption{};
}

void AdmissionDesk::admit(const CandidateList& list) {
  JoinAnswer answer = desk_.book().listing(config_.incarnation);
  answer.epoch = desk_.view().epoch;
  answer.members = desk_.view().members;
  answer.state = static_cast<std::uint8_t>(JoinState::admitted);
  answer.briefing = briefing_;
  for (const Candidate& candidate : list.candidates) answer.joining |= std::uint64_t{1} << candidate.rank;
  answer.meeting_rank = meeting_rank_;
  meeting_point_->admit(list.candidates, answer);
}

}  // namespace earshot
