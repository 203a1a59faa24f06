// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <set>
#include <string>
#include <zmq.hpp>

#include "trainer/net/curve_gate.h"
#include "trainer/net/curve_keys.h"
#include "trainer/net/ring_config.h"

namespace earshot {

/// Whether the rendezvous is one that other hosts can reach: neither ipc nor the loopback interface.
bool leaves_host(const std::string& rendezvous);

/// The mechanism of all links of one run: CURVE where the meeting point is tcp and there are keys, else none.  Throws InputError for files
/// that are refused (curve_keys.h).
class LinkSecurity {
 public:
  LinkSecurity() = default;
  explicit LinkSecurity(const RingConfig& config);

  [[nodiscard]] bool encrypted() const { return !keys_.public_key.empty(); }
  /// Own public key; empty without CURVE.
  [[nodiscard]] const std::string& public_key() const { return keys_.public_key; }
  [[nodiscard]] const std::string& meeting_key() const { return meeting_key_; }
  /// Call before the first listener of the context: decides which peers may connect.  Null without CURVE.
  [[nodiscard]] std::unique_ptr<CurveGate> open_gate(zmq::context_t& context) const;
  void secure_listener(zmq::socket_t& socket) const;
  /// server_key: public key of the listener.
  void secure_dialer(zmq::socket_t& socket, const std::string& server_key) const;
  /// The fault of a peer that states this public key in this message; empty if it is allowed.  The gate has seen the peer prove that it has
  /// the secret key.
  [[nodiscard]] std::string objection_to(const std::string& public_key, const zmq::message_t& message) const;

 private:
  CurveKeys keys_;
  std::string meeting_key_;
  std::set<std::string> allowed_;
};

}  // namespace earshot
