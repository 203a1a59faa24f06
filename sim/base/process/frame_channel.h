// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "sim/base/file_descriptor.h"

namespace earshot {

/// Whole messages between two processes over a socket: kind, length, bytes.  Nothing of the other side is believed: a message is at most
/// `max_bytes`, and no call waits beyond its time.  A side that has ended never raises SIGPIPE here.
class FrameChannel {
 public:
  using Clock = std::chrono::steady_clock;
  enum class Status { done, timed_out, closed, too_large };

  explicit FrameChannel(Descriptor socket) : socket_(std::move(socket)) {}

  /// Sends the parts as one message.  deadline: none waits for ever.
  Status send(std::uint64_t kind, std::span<const std::string_view> parts, std::optional<Clock::time_point> deadline);
  /// kind, bytes: of the next message.
  Status receive(std::uint64_t& kind, std::string& bytes, std::uint64_t max_bytes, std::optional<Clock::time_point> deadline);

 private:
  Status wait_for(short event, std::optional<Clock::time_point> deadline) const;
  Status write(std::string_view bytes, std::optional<Clock::time_point> deadline) const;
  Status read(char* bytes, std::size_t count, std::optional<Clock::time_point> deadline) const;

  Descriptor socket_;
};

/// Two ends that are closed in programs that others start meanwhile; the second lies above 0 to 3.  Throws RunError.
struct SocketPair {
  Descriptor ours, theirs;
};
SocketPair make_socket_pair();

}  // namespace earshot
