// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/socket_monitor.h"

#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <thread>
#include <vector>

namespace earshot {
namespace {

using std::chrono::milliseconds;

constexpr int kEnds = ZMQ_EVENT_DISCONNECTED | ZMQ_EVENT_CLOSED;
constexpr int kDeadline_ms = 10'000;

/// A listener at a free port, to which sockets of the test connect.
struct Listener {
  explicit Listener(zmq::context_t& context) : socket(context, zmq::socket_type::router) {
    socket.set(zmq::sockopt::linger, 0);
    socket.set(zmq::sockopt::rcvtimeo, kDeadline_ms);
    socket.bind("tcp://127.0.0.1:*");
  }
  [[nodiscard]] std::string endpoint() const { return socket.get(zmq::sockopt::last_endpoint); }
  /// Whether a message comes before the deadline.
  bool hears() {
    zmq::message_t id, text;
    return socket.recv(id).has_value() && socket.recv(text).has_value();
  }
  zmq::socket_t socket;
};

zmq::socket_t dialer(zmq::context_t& context) {
  zmq::socket_t socket(context, zmq::socket_type::dealer);
  socket.set(zmq::sockopt::linger, 0);
  socket.set(zmq::sockopt::reconnect_ivl, -1);
  return socket;
}

bool says_something(zmq::socket_t& socket, Listener& listener) {
  return socket.send(zmq::str_buffer("x"), zmq::send_flags::dontwait).has_value() && listener.hears();
}

TEST(SocketMonitor, TellsThatAConnectionHasEnded) {
  zmq::context_t context;
  auto listener = std::make_unique<Listener>(context);
  zmq::socket_t socket = dialer(context);
  SocketMonitor monitor(context, socket, kEnds, "inproc://monitor");
  socket.connect(listener->endpoint());
  ASSERT_TRUE(says_something(socket, *listener));
  EXPECT_FALSE(monitor.next());
  listener.reset();
  zmq_pollitem_t item{monitor.reader().handle(), 0, ZMQ_POLLIN, 0};
  ASSERT_EQ(zmq_poll(&item, 1, kDeadline_ms), 1);
  const auto event = monitor.next();
  ASSERT_TRUE(event);
  EXPECT_NE(*event & kEnds, 0);
}

// An event without a reader would hold up libzmq's only I/O thread for ever, and the other connections with it.
TEST(SocketMonitor, AnEndThatNooneWatchesHoldsUpNothing) {
  zmq::context_t context;
  Listener other(context);
  zmq::socket_t to_other = dialer(context);
  to_other.connect(other.endpoint());
  ASSERT_TRUE(says_something(to_other, other));

  auto listener = std::make_unique<Listener>(context);
  zmq::socket_t socket = dialer(context);
  auto monitor = std::make_unique<SocketMonitor>(context, socket, kEnds, "inproc://monitor");
  socket.connect(listener->endpoint());
  ASSERT_TRUE(says_something(socket, *listener));
  monitor.reset();
  listener.reset();
  std::this_thread::sleep_for(milliseconds(100));  // for the end to be noticed
  EXPECT_TRUE(says_something(to_other, other));
}

TEST(SocketMonitor, WatchesAnotherSocketAfterAMove) {
  zmq::context_t context;
  Listener other(context);
  zmq::socket_t to_other = dialer(context);
  to_other.connect(other.endpoint());
  std::vector<std::unique_ptr<Listener>> listeners;
  std::vector<zmq::socket_t> sockets;
  for (int i = 0; i < 2; ++i) {
    listeners.push_back(std::make_unique<Listener>(context));
    sockets.push_back(dialer(context));
  }
  SocketMonitor monitor(context, sockets[0], kEnds, "inproc://monitor-0");
  SocketMonitor second(context, sockets[1], kEnds, "inproc://monitor-1");
  for (std::size_t i = 0; i < 2; ++i) {
    sockets[i].connect(listeners[i]->endpoint());
    ASSERT_TRUE(says_something(sockets[i], *listeners[i]));
  }
  monitor = std::move(second);
  listeners[0].reset();
  std::this_thread::sleep_for(milliseconds(100));
  EXPECT_FALSE(monitor.next());
  EXPECT_TRUE(says_something(to_other, other));
  listeners[1].reset();
  zmq_pollitem_t item{monitor.reader().handle(), 0, ZMQ_POLLIN, 0};
  EXPECT_EQ(zmq_poll(&item, 1, kDeadline_ms), 1);
  EXPECT_TRUE(monitor.next());
}

// Of many connections, some end at the very time at which they are dropped.
TEST(SocketMonitor, ConnectionsThatEndWhileTheyAreDroppedHoldUpNothing) {
  zmq::context_t context;
  Listener other(context);
  zmq::socket_t to_other = dialer(context);
  to_other.connect(other.endpoint());
  for (int round = 0; round < 200; ++round) {
    auto listener = std::make_unique<Listener>(context);
    {
      zmq::socket_t socket = dialer(context);
      const SocketMonitor monitor(context, socket, kEnds, "inproc://round-" + std::to_string(round));
      socket.connect(listener->endpoint());
      ASSERT_TRUE(says_something(socket, *listener));
      listener.reset();
      std::this_thread::sleep_for(std::chrono::microseconds(round));
    }
    if (round % 20 == 19) {
      ASSERT_TRUE(says_something(to_other, other)) << round;
    }
  }
}

}  // namespace
}  // namespace earshot
