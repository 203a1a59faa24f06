// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>
#include <zmq.hpp>

#include "trainer/net/curve_keys.h"

namespace earshot {

/// Unknown peers at one port of the loopback interface, of six kinds in turn: one that connects and says nothing, 5,000 bytes of noise, a
/// greeting of another version of ZMTP, a hello without a key, one with a key that is not on the list, and an allowed key whose owner is no
/// worker and sends ten messages of noise.  So many a second, each for 40 ms at most; nothing is sent to another host.
class Flood {
 public:
  Flood(int port, CurveKeys allowed, int peers_per_s)
      : port_(port), allowed_(std::move(allowed)), unknown_(make_curve_keys()), peers_per_s_(peers_per_s) {}

  /// As long as `goes_on` says so, and for so many seconds at most.  Returns the number of peers.
  int run(double seconds, const std::function<bool()>& goes_on) {
    const auto start = std::chrono::steady_clock::now();
    int peers = 0;
    while (goes_on()) {
      const double passed_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
      if (passed_s >= seconds) break;
      sockets_before_ = std::exchange(sockets_, {});  // the sockets of the tick before last are closed
      for (const int descriptor : std::exchange(descriptors_, {})) ::close(descriptor);
      // A tick that comes late makes up for at most one that was missed.
      for (int due = 0; peers < passed_s * peers_per_s_ && due < peers_per_s_ / 25 + 1; ++due) connect(peers++);
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    for (const int descriptor : std::exchange(descriptors_, {})) ::close(descriptor);
    sockets_.clear();
    sockets_before_.clear();
    return peers;
  }

 private:
  void connect(int peer) {
    switch (peer % 6) {
      case 0:
        return raw("");
      case 1:
        return raw(std::string(5000, '\xA5'));
      case 2:
        return raw(std::string("\xFF\0\0\0\0\0\0\0\x01\x7F\x01\0", 12));
      case 3:
        return dial(nullptr, 1);
      case 4:
        return dial(&unknown_, 1);
      default:
        return dial(&allowed_, 10);
    }
  }
  void raw(const std::string& bytes) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port_));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const int descriptor = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (descriptor < 0) return;
    if (::connect(descriptor, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0 && !bytes.empty())
      static_cast<void>(::send(descriptor, bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT));
    descriptors_.push_back(descriptor);
  }
  void dial(const CurveKeys* keys, int messages) {
    zmq::socket_t socket(context_, zmq::socket_type::dealer);
    socket.set(zmq::sockopt::linger, 0);
    if (keys != nullptr) {
      socket.set(zmq::sockopt::curve_serverkey, allowed_.public_key);
      socket.set(zmq::sockopt::curve_publickey, keys->public_key);
      socket.set(zmq::sockopt::curve_secretkey, keys->secret_key);
    }
    socket.connect("tcp://127.0.0.1:" + std::to_string(port_));
    for (int i = 0; i < messages; ++i) socket.send(zmq::buffer(std::string(100, '\x5A')), zmq::send_flags::dontwait);
    sockets_.push_back(std::move(socket));
  }

  int port_;
  CurveKeys allowed_, unknown_;
  int peers_per_s_;
  zmq::context_t context_;
  std::vector<zmq::socket_t> sockets_, sockets_before_;
  std::vector<int> descriptors_;
};

}  // namespace earshot
