// SPDX-License-Identifier: Apache-2.0
#include "sim/base/process/frame_channel.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>

#include "sim/base/errors.h"
#include "sim/base/process/child_program.h"

namespace earshot {

FrameChannel::Status FrameChannel::wait_for(short event, std::optional<Clock::time_point> deadline) const {
  for (;;) {
    int wait_ms = -1;
    if (deadline) {
      const auto left = std::chrono::ceil<std::chrono::milliseconds>(*deadline - Clock::now()).count();
      if (left <= 0) return Status::timed_out;
      wait_ms = static_cast<int>(std::min<long>(left, 1000));
    }
    pollfd waited{socket_.get(), event, 0};
    const int ready = ::poll(&waited, 1, wait_ms);
    if (ready < 0 && errno != EINTR) return Status::closed;
    if (ready > 0) return Status::done;  // an end that is closed shows in the call that follows
  }
}

FrameChannel::Status FrameChannel::write(std::string_view bytes, std::optional<Clock::time_point> deadline) const {
  while (!bytes.empty()) {
    const ssize_t count = ::send(socket_.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (count > 0) {
      bytes.remove_prefix(static_cast<std::size_t>(count));
      continue;
    }
    if (count < 0 && errno == EINTR) continue;
    if (count == 0 || (errno != EAGAIN && errno != EWOULDBLOCK)) return Status::closed;
    if (const Status status = wait_for(POLLOUT, deadline); status != Status::done) return status;
  }
  return Status::done;
}

FrameChannel::Status FrameChannel::read(char* bytes, std::size_t wanted, std::optional<Clock::time_point> deadline) const {
  while (wanted > 0) {
    if (const Status status = wait_for(POLLIN, deadline); status != Status::done) return status;
    const ssize_t count = ::recv(socket_.get(), bytes, wanted, MSG_DONTWAIT);
    if (count < 0 && (errno == EINTR || errno == EAGAIN || errno == EWOULDBLOCK)) continue;
    if (count <= 0) return Status::closed;
    bytes += count;
    wanted -= static_cast<std::size_t>(count);
  }
  return Status::done;
}

FrameChannel::Status FrameChannel::send(std::uint64_t kind, std::span<const std::string_view> parts,
                                        std::optional<Clock::time_point> deadline) {
  std::array<std::uint64_t, 2> head{kind, 0};
  for (const std::string_view part : parts) head[1] += part.size();
  Status status = write({reinterpret_cast<const char*>(head.data()), sizeof head}, deadline);
  for (const std::string_view part : parts)
    if (status == Status::done) status = write(part, deadline);
  return status;
}

FrameChannel::Status FrameChannel::receive(std::uint64_t& kind, std::string& bytes, std::uint64_t max_bytes,
                                           std::optional<Clock::time_point> deadline) {
  std::array<std::uint64_t, 2> head{};
  if (const Status status = read(reinterpret_cast<char*>(head.data()), sizeof head, deadline); status != Status::done) return status;
  kind = head[0];
  if (head[1] > max_bytes) return Status::too_large;
  bytes.resize(head[1]);
  return read(bytes.data(), bytes.size(), deadline);
}

SocketPair make_socket_pair() {
  std::array<int, 2> ends{};
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0) throw RunError("socket", "cannot be opened: " + last_error());
  SocketPair pair{Descriptor(ends[0]), Descriptor(ends[1])};
  pair.theirs = Descriptor(::fcntl(ends[1], F_DUPFD_CLOEXEC, kAnswerDescriptor + 1));
  if (pair.theirs.get() < 0) throw RunError("socket", "cannot be opened: " + last_error());
  return pair;
}

}  // namespace earshot
