// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/join_request.h"

#include <fmt/format.h>
#include <sys/random.h>

#include <algorithm>

#include "sim/base/errors.h"
#include "sim/base/process/stop_signals.h"
#include "sim/base/text/log.h"
#include "trainer/net/meeting_sockets.h"
#include "trainer/net/rendezvous.h"

namespace earshot {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kAskInterval(250);
constexpr int kReconnect_ms = 50, kReconnectMax_ms = 250;

/// A connection to whoever listens at the meeting point, over which one request is sent again and again.
class Asker {
 public:
  Asker(zmq::context_t& context, const RingConfig& config, const LinkSecurity& security, const JoinRequest& request)
      : config_(config),
        security_(security),
        where_(fmt::format("rendezvous {}", config.rendezvous)),
        text_(encode(request)),
        socket_(open_meeting_socket(context, zmq::socket_type::dealer, config.rendezvous)),
        handshakes_(context, socket_) {
    socket_.set(zmq::sockopt::reconnect_ivl, kReconnect_ms);
    socket_.set(zmq::sockopt::linger, 0);
    socket_.set(zmq::sockopt::immediate, true);  // nothing is queued while no one listens
    socket_.set(zmq::sockopt::reconnect_ivl_max, kReconnectMax_ms);
    security.secure_dialer(socket_, security.meeting_key());
    try {
      socket_.connect(config.rendezvous);
    } catch (const zmq::error_t& error) {
      throw InputError(config.rendezvous, fmt::format("cannot be connected to: {}", error.what()), "check the address");
    }
  }

  /// The first answer in one of these states.
  JoinAnswer ask(JoinState wanted) {
    heard_at_ = Clock::now();
    while (true) {
      if (StopSignals::received()) throw RunError(where_, "a signal stopped this worker before it joined");
      send();
      const Readable readable = wait_readable(socket_, Clock::now() + kAskInterval, &handshakes_.socket());
      if (readable == Readable::second) handshakes_.read(where_, security_);
      if (readable == Readable::first) {
        const JoinAnswer answer = read();
        // Without a briefing the run prepares its first update.
        if (answer.state == static_cast<std::uint8_t>(wanted) && !answer.briefing.empty()) return answer;
      }
      give_up_after_silence();
    }
  }

 private:
  void send() {
    try {
      if (Clock::now() - asked_at_ >= kAskInterval && socket_.send(zmq::buffer(text_), zmq::send_flags::dontwait)) asked_at_ = Clock::now();
    } catch (const zmq::error_t& error) {
      if (error.num() != EINTR) throw;
    }
  }

  JoinAnswer read() {
    const auto parts = receive_parts(socket_);
    heard_at_ = Clock::now();
    answered_ = true;
    JoinAnswer answer;
    try {
      if (parts.size() != 1) throw WireError("answer with several parts");
      answer = decode<JoinAnswer>(parts[0].to_string_view());
    } catch (const WireError& error) {
      bool begins = false;
      try {
        static_cast<void>(decode<Welcome>(parts.empty() ? std::string_view() : parts[0].to_string_view()));
        begins = true;
      } catch (const WireError&) {
      }
      if (begins) throw InputError(where_, "the run has not started yet", "start this worker without --join");
      throw RunError(where_, fmt::format("the run uses another protocol: {}", error.what()));
    }
    if (answer.state == static_cast<std::uint8_t>(JoinState::refused))
      throw InputError(where_, fmt::format("the run refuses worker {}: {}", config_.identity.rank, answer.reason),
                       "use the same program, config and keys as the run");
    if (!answer.reason.empty() && answer.reason != reason_)
      log_info(fmt::format("worker {} waits: {}", config_.identity.rank, answer.reason));
    // A rank that still takes part is missed within an update, or this one was started twice.
    if (answer.reason.empty() || answer.state != static_cast<std::uint8_t>(JoinState::waits)) held_up_since_ = Clock::now();
    reason_ = answer.reason;
    if (Clock::now() - held_up_since_ > config_.timeout) throw RunError(where_, fmt::format("cannot be joined: {}", reason_));
    return answer;
  }

  void give_up_after_silence() const {
    // A member that loads a large scene looks here as late as it may tell of progress.
    const auto limit =
        answered_ ? std::chrono::milliseconds(static_cast<std::int64_t>(1000 * config_.network.progress_timeout_s)) : config_.timeout;
    if (Clock::now() - heard_at_ < limit) return;
    throw RunError(
        where_, answered_
                    ? fmt::format("no worker of the run has answered for {} ms: the run has ended, or the rendezvous address has changed",
                                  limit.count())
                    : fmt::format("no worker of a run has answered within {} ms; if the host of rank 0 is lost, set EARSHOT_RENDEZVOUS to "
                                  "the address in the log of the lowest worker",
                                  limit.count()));
  }

  const RingConfig& config_;
  const LinkSecurity& security_;
  std::string where_, text_, reason_;
  zmq::socket_t socket_;
  HandshakeMonitor handshakes_;
  Clock::time_point asked_at_, heard_at_, held_up_since_ = Clock::now();
  bool answered_ = false;
};

JoinRequest request_of(const RingConfig& config, const LinkSecurity& security) {
  JoinRequest request;
  request.run_id = config.run_id;
  request.rank = config.identity.rank;
  request.world_size = config.identity.world_size;
  request.incarnation = config.incarnation;
  request.public_key = security.public_key();
  request.engine = config.engine;
  request.settings = config.settings;
  return request;
}

}  // namespace

std::string ask_for_briefing(const RingConfig& asked) {
  const RingConfig config = resolved(asked);
  zmq::context_t context(1);
  const LinkSecurity security(config);
  return Asker(context, config, security, request_of(config, security)).ask(JoinState::waits).briefing;
}

JoinAnswer ask_for_admission(zmq::context_t& context, const RingConfig& config, const std::string& control_endpoint,
                             const std::string& bulk_endpoint, const LinkSecurity& security) {
  JoinRequest request = request_of(config, security);
  request.control_endpoint = control_endpoint;
  request.bulk_endpoint = bulk_endpoint;
  JoinAnswer answer = Asker(context, config, security, request).ask(JoinState::admitted);
  try {
    check(answer, config, security.encrypted());
  } catch (const WireError& error) {
    throw RunError(fmt::format("rendezvous {}", config.rendezvous), fmt::format("the run uses another protocol: {}", error.what()));
  }
  return answer;
}

std::uint32_t new_incarnation() {
  std::uint32_t number = 0;
  while (number == 0)
    if (::getrandom(&number, sizeof(number), 0) != sizeof(number)) throw RunError("getrandom", "returned no random bytes");
  return number;
}

}  // namespace earshot
