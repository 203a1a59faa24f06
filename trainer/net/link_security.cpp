// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/link_security.h"

#include "sim/base/errors.h"
#include "trainer/net/host_address.h"

namespace earshot {
namespace {

constexpr int kHandshake_ms = 5000;  // a peer that connects and says nothing holds its connection no longer

}  // namespace

bool leaves_host(const std::string& rendezvous) { return rendezvous.starts_with("tcp://") && !is_loopback(parse_tcp(rendezvous).host); }

LinkSecurity::LinkSecurity(const RingConfig& config) {
  const NetworkConfig& network = config.network;
  if (!config.rendezvous.starts_with("tcp://") || network.curve_key_file.empty()) return;
  if (!has_curve())
    throw InputError("network.curve_key_file", "needs CURVE, which this build of libzmq does not have", "install libzmq with libsodium");
  keys_ = read_curve_keys(network.curve_key_file);
  meeting_key_ = network.meeting_key.empty() ? keys_.public_key : network.meeting_key;
  if (!network.allow_list.empty()) allowed_ = read_allow_list(network.allow_list);
  allowed_.insert(keys_.public_key);
}

std::unique_ptr<CurveGate> LinkSecurity::open_gate(zmq::context_t& context) const {
  return encrypted() ? std::make_unique<CurveGate>(context, allowed_) : nullptr;
}

void LinkSecurity::secure_listener(zmq::socket_t& socket) const {
  socket.set(zmq::sockopt::handshake_ivl, kHandshake_ms);
  if (!encrypted()) return;
  socket.set(zmq::sockopt::curve_server, true);
  socket.set(zmq::sockopt::curve_secretkey, keys_.secret_key);
  socket.set(zmq::sockopt::zap_domain, kZapDomain);
}

void LinkSecurity::secure_dialer(zmq::socket_t& socket, const std::string& server_key) const {
  if (!encrypted()) return;
  socket.set(zmq::sockopt::curve_serverkey, server_key);
  socket.set(zmq::sockopt::curve_publickey, keys_.public_key);
  socket.set(zmq::sockopt::curve_secretkey, keys_.secret_key);
}

std::string LinkSecurity::objection_to(const std::string& public_key, const zmq::message_t& message) const {
  if (encrypted() != !public_key.empty()) return "either it or this run has no keys";
  if (!encrypted()) return {};
  const char* proven = ::zmq_msg_gets(message.handle(), "User-Id");
  return proven != nullptr && public_key == proven ? "" : "its public key does not match the key of its connection";
}

}  // namespace earshot
