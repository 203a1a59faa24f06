// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/meeting_point.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>

#include "sim/base/errors.h"
#include "sim/base/text/log.h"
#include "trainer/net/host_address.h"
#include "trainer/net/meeting_sockets.h"

namespace earshot {
namespace {

constexpr std::chrono::milliseconds kLookInterval(20);
constexpr std::chrono::seconds kTryInterval(1);   // between attempts to listen where another socket still does
constexpr std::chrono::seconds kSilenceLimit(3);  // a candidate asks several times a second
constexpr int kMessagesAtOnce = 100, kRefusalsPerSecond = 100;
constexpr std::string_view kIpc = "ipc://";

std::string encoded_answer(JoinState state, const std::string& reason, const std::string& briefing = {}) {
  JoinAnswer answer;
  answer.state = static_cast<std::uint8_t>(state);
  answer.reason = reason;
  answer.briefing = briefing;
  return encode(answer);
}

/// Where the run began for the rank 0 that began it.  Elsewhere the port stays, at the address where this worker listens anyway: a rank 0
/// that has come back may have met the run on another host.
std::string address_for(const RingConfig& config, const std::string& control_endpoint) {
  if ((config.identity.rank == 0 && config.incarnation == 0) || !leaves_host(config.rendezvous)) return meeting_address(config);
  return TcpAddress{parse_tcp(control_endpoint).host, parse_tcp(config.rendezvous).port}.endpoint();
}

}  // namespace

MeetingPoint::MeetingPoint(zmq::context_t& context, const RingConfig& config, const LinkSecurity& security,
                           const std::string& control_endpoint, zmq::socket_t socket)
    : context_(context), config_(config), security_(security), address_(address_for(config, control_endpoint)), socket_(std::move(socket)) {
  if (!socket_) open();
}

MeetingPoint::~MeetingPoint() {
  try {
    if (!socket_) return;
    const std::string text = encoded_answer(JoinState::refused, "the run ends");
    for (const auto& [rank, waiting] : waiting_) send(waiting.routing_id, text);
    socket_.set(zmq::sockopt::linger, 300);
  } catch (const std::exception&) {  // they ask in vain, and give up
  }
}

void MeetingPoint::open() {
  const auto now = Clock::now();
  if (tried_at_ != Clock::time_point() && now - tried_at_ < kTryInterval) return;
  tried_at_ = now;
  zmq::socket_t socket = open_meeting_socket(context_, zmq::socket_type::router, address_);
  socket.set(zmq::sockopt::router_mandatory, true);
  security_.secure_listener(socket);
  try {
    socket.bind(address_);
    socket_ = std::move(socket);
    log_info(fmt::format("worker {} accepts rejoining workers at {}", config_.identity.rank, address_));
  } catch (const zmq::error_t& error) {
    if (!std::exchange(warned_, true))
      log_warning(fmt::format("worker {} cannot listen at {} for rejoining workers, and tries again: {}", config_.identity.rank, address_,
                              error.what()));
  }
}

bool MeetingPoint::send(const std::string& routing_id, const std::string& encoded) {
  try {
    return socket_.send(zmq::buffer(routing_id), zmq::send_flags::sndmore | zmq::send_flags::dontwait).has_value() &&
           socket_.send(zmq::buffer(encoded), zmq::send_flags::dontwait).has_value();
  } catch (const zmq::error_t&) {  // it has gone
    return false;
  }
}

void MeetingPoint::refuse(const std::string& routing_id, const std::string& encoded) {
  const auto now = Clock::now();
  if (now - second_begins_ >= std::chrono::seconds(1)) {
    second_begins_ = now;
    refusals_ = 0;
  }
  if (++refusals_ <= kRefusalsPerSecond) send(routing_id, encoded);
}

void MeetingPoint::look(const View& view, const std::string& briefing) {
  const auto now = Clock::now();
  if (now - looked_at_ < kLookInterval) return;
  looked_at_ = now;
  if (socket_ && address_.starts_with(kIpc) && now - tried_at_ >= kTryInterval) {
    tried_at_ = now;
    struct stat status {};
    if (::stat(address_.substr(kIpc.size()).c_str(), &status) != 0) {
      socket_.close();
      tried_at_ = {};
    }
  }
  if (!socket_) open();
  for (int count = 0; socket_ && count < kMessagesAtOnce && has_message(socket_); ++count) take(receive_parts(socket_), view, briefing);
}

void MeetingPoint::take(const std::vector<zmq::message_t>& parts, const View& view, const std::string& briefing) {
  if (parts.size() != 2) return;
  const std::string routing_id = parts[0].to_string();
  JoinRequest request;
  try {
    request = decode<JoinRequest>(parts[1].to_string_view());
  } catch (const WireError& error) {
    try {  // a worker that was started as if the run were new
      static_cast<void>(decode<Hello>(parts[1].to_string_view()));
      Welcome welcome;
      welcome.refusal = "the run has already started; a lost worker rejoins with --join if network.on_loss is continue";
      refuse(routing_id, encode(welcome));
    } catch (const WireError&) {
      refuse(routing_id, encoded_answer(JoinState::refused, error.what()));
    }
    return;
  }
  std::string reason = objection_to(request, config_);
  if (reason.empty()) reason = security_.objection_to(request.public_key, parts[1]);
  if (!reason.empty()) return refuse(routing_id, encoded_answer(JoinState::refused, reason));
  const auto known = waiting_.find(request.rank);
  const bool other_waits = known != waiting_.end() && known->second.candidate.incarnation != request.incarnation &&
                           Clock::now() - known->second.heard_at < kSilenceLimit;
  if (view.has(request.rank))
    reason = fmt::format("worker {} is still a member", request.rank);
  else if (other_waits)
    reason = fmt::format("another process is already waiting to join as worker {}", request.rank);
  if (reason.empty()) {
    const Candidate candidate{request.rank, request.incarnation, request.control_endpoint, request.bulk_endpoint, request.public_key};
    waiting_[request.rank] = {routing_id, candidate, request.is_ready(), Clock::now()};
  }
  send(routing_id, encoded_answer(JoinState::waits, reason, briefing));
}

std::vector<Candidate> MeetingPoint::ready(const View& view, const std::string& briefing) {
  looked_at_ = {};
  look(view, briefing);
  const std::string text = encoded_answer(JoinState::waits, {}, briefing);
  std::vector<Candidate> candidates;
  for (auto it = waiting_.begin(); it != waiting_.end();) {
    const bool gone = view.has(it->first) || Clock::now() - it->second.heard_at >= kSilenceLimit || !send(it->second.routing_id, text);
    if (!gone && it->second.is_ready) candidates.push_back(it->second.candidate);
    it = gone ? waiting_.erase(it) : std::next(it);
  }
  return candidates;
}

void MeetingPoint::admit(const std::vector<Candidate>& candidates, const JoinAnswer& answer) {
  const std::string text = encode(answer);
  for (const Candidate& candidate : candidates) {
    const auto waiting = waiting_.find(candidate.rank);
    if (waiting == waiting_.end()) continue;
    send(waiting->second.routing_id, text);
    waiting_.erase(waiting);
  }
}

}  // namespace earshot
