// SPDX-License-Identifier: Apache-2.0
// The meeting point of a run under way: where it is, and what a worker makes of answers that cannot be.
#include "trainer/net/meeting_point.h"

#include <gtest/gtest.h>

#include <atomic>
#include <functional>
#include <thread>

#include "sim/base/errors.h"
#include "tests/support/workers/curve_ring.h"
#include "tests/support/workers/joining_workers.h"
#include "trainer/net/meeting_sockets.h"

namespace earshot {
namespace {

/// Where a worker listens whose rendezvous is that of a host other than its own, 192.0.2.0/24 being no one's (RFC 5737).
std::string address_of(int rank, std::uint32_t incarnation, int port) {
  RingConfig config;
  config.identity = {rank, 4};
  config.incarnation = incarnation;
  config.rendezvous = "tcp://192.0.2.7:" + std::to_string(port);
  zmq::context_t context(1);
  const LinkSecurity security;
  return MeetingPoint(context, config, security, "tcp://127.0.0.1:40001").address();
}

TEST(MeetingPoint, IsAtTheOwnAddressUnlessTheRunBeganThere) {
  const int port = free_port();
  const std::string own_address = "tcp://127.0.0.1:" + std::to_string(port);
  EXPECT_EQ(address_of(0, 0, port),
            "tcp://192.0.2.7:" + std::to_string(port));  // what the others were told, whatever this host calls itself
  EXPECT_EQ(address_of(0, 5, port), own_address);
  EXPECT_EQ(address_of(2, 0, port), own_address);
  EXPECT_EQ(address_of(2, 5, port), own_address);
}

/// Whoever listens at the address of a run of three workers, where 0 and 1 are left, and admits rank 2 with an answer of its own.
class AnsweringPeer {
 public:
  AnsweringPeer(const RingConfig& config, const std::function<void(JoinAnswer&)>& change)
      : socket_(open_meeting_socket(context_, zmq::socket_type::router, config.rendezvous)) {
    answer_.state = static_cast<std::uint8_t>(JoinState::admitted);
    answer_.briefing = "known";
    answer_.run_key = 7;
    answer_.members = 0b011;
    answer_.joining = 0b100;
    answer_.meeting_rank = 0;
    for (const char* rank : {"0", "1", "2"}) {
      answer_.control_endpoints.push_back(config.rendezvous + ".control." + rank);
      answer_.bulk_endpoints.push_back(config.rendezvous + ".bulk." + rank);
    }
    answer_.public_keys.resize(3);
    answer_.incarnations = {0, 0, 7};
    change(answer_);
    socket_.bind(config.rendezvous);
    thread_ = std::jthread([this](const std::stop_token& stop) {
      while (!stop.stop_requested()) {
        if (wait_readable(socket_, std::chrono::steady_clock::now() + std::chrono::milliseconds(20)) != Readable::first) continue;
        const auto parts = receive_parts(socket_);
        socket_.send(zmq::buffer(parts[0].to_string()), zmq::send_flags::sndmore);
        socket_.send(zmq::buffer(encode(answer_)), zmq::send_flags::none);
      }
    });
  }

 private:
  zmq::context_t context_{1};
  zmq::socket_t socket_;
  JoinAnswer answer_;
  std::jthread thread_;
};

class JoinAnswers : public testing::Test {
 protected:
  /// What a worker says to an answer; nothing of it stays in the folder.
  std::string error_after(const std::function<void(JoinAnswer&)>& change) {
    RingConfig config = joinable(ring_in(folder_, 2, 3));
    config.incarnation = 7;
    config.timeout = std::chrono::milliseconds(1500);
    const AnsweringPeer peer(config, change);
    std::string error;
    try {
      make_zmq_ring(config);
    } catch (const std::exception& failure) {
      error = failure.what();
    }
    for (const auto& entry : std::filesystem::directory_iterator(folder_.path()))
      EXPECT_EQ(entry.path().filename().string().find(".2."), std::string::npos) << entry.path();
    return error;
  }
  PrivateTestFolder folder_;
};

TEST_F(JoinAnswers, ThoseThatCannotBeAreNamedAndLeaveNoFile) {
  const auto expect_view_refused = [&](const std::function<void(JoinAnswer&)>& change) {
    EXPECT_NE(error_after(change).find("invalid membership view"), std::string::npos);
  };
  expect_view_refused([](JoinAnswer& answer) { answer.meeting_rank = 2; });
  expect_view_refused([](JoinAnswer& answer) { answer.meeting_rank = 70; });
  expect_view_refused([](JoinAnswer& answer) { answer.meeting_rank = -1; });
  expect_view_refused([](JoinAnswer& answer) { answer.members = 0b1011; });
  expect_view_refused([](JoinAnswer& answer) { answer.joining = 0b101; });
  EXPECT_NE(error_after([](JoinAnswer& answer) { answer.public_keys.resize(2); }).find("table of the wrong size"), std::string::npos);
  EXPECT_NE(error_after([](JoinAnswer& answer) { answer.control_endpoints[1] = "tcp://192.0.2.7:80"; }).find("invalid worker endpoint"),
            std::string::npos);
}

}  // namespace
}  // namespace earshot
