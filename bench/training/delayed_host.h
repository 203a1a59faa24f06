// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <chrono>
#include <filesystem>
#include <string>
#include <thread>
#include <utility>

namespace earshot {

/// Makes the calling process a host of its own, whose packets reach the others with a delay: a network namespace with one interface
/// (a tun device, 10.78.0.HOST+1/24, packets of 9,000 bytes), from which a thread takes the packets and hands them on after the delay, in
/// order and without loss.  It does what `tc netem` does, on kernels that lack that.  To be made before the process has other threads or
/// sockets; it stays in its namespace.  Needs root (CAP_SYS_ADMIN, CAP_NET_ADMIN) and /dev/net/tun.
class DelayedHost {
 public:
  /// A descriptor that is closed at the end; negative if closed.
  class Descriptor {
   public:
    explicit Descriptor(int number) : number_(number) {}
    ~Descriptor();
    Descriptor(Descriptor&& other) noexcept : number_(std::exchange(other.number_, -1)) {}
    Descriptor& operator=(Descriptor&&) = delete;
    [[nodiscard]] int number() const { return number_; }

   private:
    int number_;
  };

  static constexpr int kMaxHosts = 64;

  /// folder: one that all hosts share and only their owner may enter; packets travel through sockets in it.  delay: of one way.  Throws
  /// RunError, one line, where this machine does not give it.
  DelayedHost(int host, std::chrono::microseconds delay, const std::filesystem::path& folder);
  /// Waits until what has been sent is on its way, but for no host that does not take its packets.
  ~DelayedHost();
  DelayedHost(const DelayedHost&) = delete;
  DelayedHost& operator=(const DelayedHost&) = delete;

  [[nodiscard]] static std::string address(int host) { return "10.78.0." + std::to_string(host + 1); }

 private:
  void send_delayed();
  void receive();

  std::chrono::microseconds delay_;
  std::filesystem::path folder_;
  Descriptor packets_, tun_;
  std::atomic<bool> over_{false};
  std::thread sender_, receiver_;
};

}  // namespace earshot
