// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <set>
#include <string>
#include <thread>
#include <zmq.hpp>

namespace earshot {

/// Name under which listening sockets ask this gate; without a domain libzmq would let every key in.
inline constexpr const char* kZapDomain = "earshot";

/// Decides which public keys may connect to the CURVE listeners of a context: the handler of ZAP (ZeroMQ RFC 27), one thread that answers
/// libzmq's I/O thread.  Has to live from before the first such listener binds until all sockets of the context are closed; at most one per
/// context.  Messages of admitted peers carry their public key as the property "User-Id".  A refused peer is counted, and named by address
/// in a warning at most every ten seconds.
class CurveGate {
 public:
  CurveGate(zmq::context_t& context, std::set<std::string> allowed);
  ~CurveGate();
  CurveGate(const CurveGate&) = delete;
  CurveGate& operator=(const CurveGate&) = delete;

  /// Safe from any thread.
  [[nodiscard]] std::uint64_t refused() const { return refused_; }

 private:
  void serve();
  void answer_one();

  const std::set<std::string> allowed_;
  zmq::socket_t requests_, stop_, stopped_;
  std::atomic<std::uint64_t> refused_{0};
  std::chrono::steady_clock::time_point warned_at_;  ///< of the thread
  std::thread thread_;
};

}  // namespace earshot
