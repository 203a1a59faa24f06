// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <zmq.hpp>

namespace earshot {

/// libzmq's events of one socket (zmq_socket_monitor), read by the thread that owns both.
///
/// It has to end before the socket that it watches closes: declare it after that socket.  libzmq's I/O thread waits without limit to send
/// an event for which there is no reader any more, and with it all connections of the context, so that watching is stopped before the
/// reader closes.
class SocketMonitor {
 public:
  /// events: an or of ZMQ_EVENT_*.  address: an inproc:// name that no other monitor of the context has.  Throws zmq::error_t.
  SocketMonitor(zmq::context_t& context, zmq::socket_t& watched, int events, const std::string& address);
  ~SocketMonitor() { stop(); }
  SocketMonitor(SocketMonitor&& other) noexcept : watched_(std::exchange(other.watched_, nullptr)), reader_(std::move(other.reader_)) {}
  SocketMonitor& operator=(SocketMonitor&& other) noexcept;
  SocketMonitor(const SocketMonitor&) = delete;
  SocketMonitor& operator=(const SocketMonitor&) = delete;

  /// For zmq_poll(): readable when an event has come.
  [[nodiscard]] zmq::socket_t& reader() { return reader_; }
  /// The next event, if one has come: ZMQ_EVENT_*, or 0 for a message that is none.  Never waits.
  std::optional<std::uint16_t> next();

 private:
  void stop() noexcept;

  void* watched_;  ///< null where another object has taken over
  zmq::socket_t reader_;
};

}  // namespace earshot
