// SPDX-License-Identifier: Apache-2.0
#include "bench/training/delayed_host.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <linux/if_tun.h>
#include <net/if.h>
#include <netinet/in.h>
#include <poll.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <deque>
#include <vector>

#include "sim/base/errors.h"

namespace earshot {
namespace {

using Clock = std::chrono::steady_clock;
using Descriptor = DelayedHost::Descriptor;

constexpr int kPacketBytes = 9000, kQueuedPackets = 20000;
constexpr std::size_t kDestination = 16;  // of an IPv4 header: four bytes, the last of which is the host's
constexpr std::chrono::milliseconds kLook(50);

[[noreturn]] void fail(const char* operation) {
  throw RunError("delayed link", fmt::format("{}: {} (it needs root and /dev/net/tun)", operation, std::strerror(errno)));
}

sockaddr_un socket_of(const std::filesystem::path& folder, int host) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::string path = (folder / fmt::format("packets{}", host)).string();
  if (path.size() >= sizeof(address.sun_path)) throw RunError(path, "is too long for a socket; use a shorter path");
  std::memcpy(static_cast<char*>(address.sun_path), path.c_str(), path.size() + 1);
  return address;
}

template <class Address>
const sockaddr* generic(const Address& address) {
  return reinterpret_cast<const sockaddr*>(&address);
}

Descriptor open_packet_socket(const std::filesystem::path& folder, int host) {
  EARSHOT_EXPECT(host >= 0 && host < DelayedHost::kMaxHosts);
  const sockaddr_un address = socket_of(folder, host);
  Descriptor packets(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  // So long a full queue holds a call up; the sender looks in between whether this host ends.
  const timeval limit{0, std::chrono::microseconds(kLook).count()};
  if (packets.number() < 0 || ::bind(packets.number(), generic(address), sizeof(address)) != 0 ||
      ::setsockopt(packets.number(), SOL_SOCKET, SO_SNDTIMEO, &limit, sizeof(limit)) != 0)
    fail("a socket for packets cannot be opened");
  return packets;
}

/// In a network namespace of its own, in which this is the only way out.
Descriptor open_tun(int host) {
  if (::unshare(CLONE_NEWNET) != 0) fail("no network namespace");
  Descriptor tun(::open("/dev/net/tun", O_RDWR | O_CLOEXEC | O_NONBLOCK));
  if (tun.number() < 0) fail("no tun device");
  const Descriptor control(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (control.number() < 0) fail("a socket for the tun device cannot be opened");
  const auto request = [](const char* name) {
    ifreq interface {};
    std::strncpy(static_cast<char*>(interface.ifr_name), name, IFNAMSIZ - 1);
    return interface;
  };
  const auto ask = [](const Descriptor& descriptor, unsigned long operation, ifreq interface) {
    if (::ioctl(descriptor.number(), operation, &interface) != 0) fail("a tun device cannot be set up");
  };
  ifreq device = request("eth0");
  device.ifr_flags = IFF_TUN | IFF_NO_PI;
  ask(tun, TUNSETIFF, device);
  for (const auto& [operation, text] :
       {std::pair<unsigned long, std::string>{SIOCSIFADDR, DelayedHost::address(host)}, {SIOCSIFNETMASK, "255.255.255.0"}}) {
    ifreq interface = request("eth0");
    sockaddr_in address{};
    address.sin_family = AF_INET;
    ::inet_pton(AF_INET, text.c_str(), &address.sin_addr);
    std::memcpy(&interface.ifr_addr, &address, sizeof(address));
    ask(control, operation, interface);
  }
  ifreq mtu = request("eth0"), queue = request("eth0"), up = request("eth0"), loopback = request("lo");
  mtu.ifr_mtu = kPacketBytes;
  queue.ifr_qlen = kQueuedPackets;
  up.ifr_flags = loopback.ifr_flags = IFF_UP;
  ask(control, SIOCSIFMTU, mtu);
  ask(control, SIOCSIFTXQLEN, queue);
  ask(control, SIOCSIFFLAGS, up);
  ask(control, SIOCSIFFLAGS, loopback);
  return tun;
}

}  // namespace

DelayedHost::Descriptor::~Descriptor() {
  if (number_ >= 0) ::close(number_);
}

DelayedHost::DelayedHost(int host, std::chrono::microseconds delay, const std::filesystem::path& folder)
    : delay_(delay), folder_(folder), packets_(open_packet_socket(folder, host)), tun_(open_tun(host)) {
  sender_ = std::thread([this] { send_delayed(); });
  receiver_ = std::thread([this] { receive(); });
}

DelayedHost::~DelayedHost() {
  std::this_thread::sleep_for(3 * delay_ + kLook);  // sent packets still arrive, and lost ones are sent again
  over_ = true;
  sender_.join();
  receiver_.join();
}

void DelayedHost::send_delayed() {
  struct Packet {
    Clock::time_point due;
    std::vector<char> bytes;
  };
  std::deque<Packet> packets;
  std::array<char, kPacketBytes + 100> buffer{};
  std::vector<sockaddr_un> hosts;
  for (int host = 0; host < kMaxHosts; ++host) hosts.push_back(socket_of(folder_, host));
  while (!over_) {
    const auto wait = packets.empty() ? std::chrono::nanoseconds(kLook) : packets.front().due - Clock::now();
    const std::int64_t wait_ns = std::max<std::int64_t>(0, wait.count());
    const timespec limit{wait_ns / 1'000'000'000, wait_ns % 1'000'000'000};
    pollfd readable{tun_.number(), POLLIN, 0};
    ::ppoll(&readable, 1, &limit, nullptr);
    const auto now = Clock::now();
    for (ssize_t size = ::read(tun_.number(), buffer.data(), buffer.size()); size > 0;
         size = ::read(tun_.number(), buffer.data(), buffer.size())) {
      packets.push_back({now + delay_, {buffer.data(), buffer.data() + size}});
      if (packets.front().due <= now) break;
    }
    for (; !over_ && !packets.empty() && packets.front().due <= Clock::now(); packets.pop_front()) {
      const std::vector<char>& bytes = packets.front().bytes;
      if (bytes.size() <= kDestination + 3 || (bytes[0] & 0xF0) != 0x40) continue;  // no IPv4
      const int host = static_cast<unsigned char>(bytes[kDestination + 3]) - 1;
      if (host < 0 || host >= kMaxHosts) continue;
      const sockaddr_un& to = hosts[static_cast<std::size_t>(host)];
      // A host that is not there yet, or not any more, gets nothing; a full queue holds the sender up.
      const auto send = [&] { return ::sendto(packets_.number(), bytes.data(), bytes.size(), MSG_NOSIGNAL, generic(to), sizeof(to)); };
      while (send() < 0 && (errno == EAGAIN || errno == EINTR) && !over_) continue;
    }
  }
}

void DelayedHost::receive() {
  std::array<char, kPacketBytes + 100> buffer{};
  while (!over_) {
    pollfd readable{packets_.number(), POLLIN, 0};
    if (::poll(&readable, 1, static_cast<int>(kLook.count())) <= 0) continue;
    const ssize_t size = ::recv(packets_.number(), buffer.data(), buffer.size(), MSG_DONTWAIT);
    if (size > 0) static_cast<void>(::write(tun_.number(), buffer.data(), static_cast<std::size_t>(size)));
  }
}

}  // namespace earshot
