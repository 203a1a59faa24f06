// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/curve_gate.h"

#include <fmt/format.h>

#include <array>
#include <vector>

#include "sim/base/text/log.h"

namespace earshot {
namespace {

constexpr const char* kStop = "inproc://earshot.gate.stop";
constexpr std::size_t kKeyBytes = 32, kMaxFrames = 7;
constexpr std::chrono::seconds kWarningInterval(10);

/// Frames of a request (RFC 27): version, request id, domain, address, routing id, mechanism, the client's public key.
enum Frame : std::size_t { version, request_id, domain, address, routing_id, mechanism, key };

std::string z85(const zmq::message_t& bytes) {
  std::array<char, kKeyBytes * 5 / 4 + 1> text{};
  ::zmq_z85_encode(text.data(), bytes.data<std::uint8_t>(), bytes.size());
  return text.data();
}

}  // namespace

CurveGate::CurveGate(zmq::context_t& context, std::set<std::string> allowed)
    : allowed_(std::move(allowed)),
      requests_(context, zmq::socket_type::rep),
      stop_(context, zmq::socket_type::pair),
      stopped_(context, zmq::socket_type::pair) {
  for (zmq::socket_t* socket : {&requests_, &stop_, &stopped_}) socket->set(zmq::sockopt::linger, 0);
  requests_.bind("inproc://zeromq.zap.01");
  stopped_.bind(kStop);
  stop_.connect(kStop);
  thread_ = std::thread([this] { serve(); });
}

CurveGate::~CurveGate() {
  try {
    stop_.send(zmq::message_t(), zmq::send_flags::none);
  } catch (const zmq::error_t&) {  // the context is being terminated, which ends the thread as well
  }
  thread_.join();
}

void CurveGate::serve() {
  try {
    while (true) {
      std::array<zmq_pollitem_t, 2> items{{{requests_.handle(), 0, ZMQ_POLLIN, 0}, {stopped_.handle(), 0, ZMQ_POLLIN, 0}}};
      if (::zmq_poll(items.data(), static_cast<int>(items.size()), -1) < 0 && ::zmq_errno() != EINTR) return;
      if ((items[1].revents & ZMQ_POLLIN) != 0) return;
      if ((items[0].revents & ZMQ_POLLIN) != 0) answer_one();
    }
  } catch (const zmq::error_t&) {  // without an answer libzmq admits no one
  }
}

void CurveGate::answer_one() {
  std::vector<zmq::message_t> frames;
  do {
    zmq::message_t frame;
    if (!requests_.recv(frame, zmq::recv_flags::none)) return;
    if (frames.size() < kMaxFrames) frames.push_back(std::move(frame));
  } while (requests_.get(zmq::sockopt::rcvmore));

  const bool whole = frames.size() == kMaxFrames && frames[mechanism].to_string_view() == "CURVE" && frames[key].size() == kKeyBytes;
  const std::string public_key = whole ? z85(frames[key]) : std::string();
  const bool admitted = whole && allowed_.contains(public_key);
  if (!admitted) {
    ++refused_;
    const auto now = std::chrono::steady_clock::now();
    if (refused_ == 1 || now - warned_at_ >= kWarningInterval) {
      warned_at_ = now;
      log_warning(fmt::format("refused {} unknown peers so far; the key of the last one, from {}, is not on the allow-list",
                              refused_.load(), frames.size() > address ? frames[address].to_string() : "an unknown address"));
    }
  }
  const std::array<std::string, 6> reply{"1.0",
                                         frames.size() > request_id ? frames[request_id].to_string() : std::string(),
                                         admitted ? "200" : "400",
                                         admitted ? "OK" : "the key is not on the allow-list",
                                         public_key,
                                         ""};
  for (std::size_t i = 0; i < reply.size(); ++i)
    requests_.send(zmq::buffer(reply[i]), i + 1 < reply.size() ? zmq::send_flags::sndmore : zmq::send_flags::none);
}

}  // namespace earshot
