// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/socket_monitor.h"

#include <cerrno>
#include <cstring>

namespace earshot {

SocketMonitor::SocketMonitor(zmq::context_t& context, zmq::socket_t& watched, int events, const std::string& address)
    : watched_(watched.handle()), reader_(context, zmq::socket_type::pair) {
  reader_.set(zmq::sockopt::linger, 0);
  if (::zmq_socket_monitor(watched_, address.c_str(), events) != 0) throw zmq::error_t();
  try {
    reader_.connect(address);
  } catch (...) {
    stop();
    throw;
  }
}

SocketMonitor& SocketMonitor::operator=(SocketMonitor&& other) noexcept {
  if (this == &other) return *this;
  stop();
  watched_ = std::exchange(other.watched_, nullptr);
  reader_ = std::move(other.reader_);
  return *this;
}

void SocketMonitor::stop() noexcept {
  if (watched_ != nullptr) ::zmq_socket_monitor(watched_, nullptr, 0);
  watched_ = nullptr;
}

std::optional<std::uint16_t> SocketMonitor::next() {
  zmq::message_t event;
  try {
    if (!reader_.recv(event, zmq::recv_flags::dontwait)) return std::nullopt;
    for (bool has_more = event.more(); has_more;) {  // the address, which came with it
      zmq::message_t rest;
      has_more = reader_.recv(rest, zmq::recv_flags::dontwait) && rest.more();
    }
  } catch (const zmq::error_t& error) {
    if (error.num() != EINTR) throw;
    if (event.size() == 0) return std::nullopt;
  }
  std::uint16_t number = 0;
  if (event.size() >= sizeof(number)) std::memcpy(&number, event.data(), sizeof(number));
  return number;
}

}  // namespace earshot
