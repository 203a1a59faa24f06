// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/host_address.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netdb.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <memory>
#include <set>
#include <thread>
#include <vector>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr std::string_view kTcp = "tcp://";

struct ReleaseAddresses {
  void operator()(addrinfo* list) const noexcept { ::freeaddrinfo(list); }
  void operator()(ifaddrs* list) const noexcept { ::freeifaddrs(list); }
};

/// Numeric text, without a zone; empty for another family than IPv4 and IPv6.
std::string text_of(const sockaddr* address) {
  std::array<char, INET6_ADDRSTRLEN> text{};
  if (address->sa_family == AF_INET)
    ::inet_ntop(AF_INET, &reinterpret_cast<const sockaddr_in*>(address)->sin_addr, text.data(), text.size());
  else if (address->sa_family == AF_INET6)
    ::inet_ntop(AF_INET6, &reinterpret_cast<const sockaddr_in6*>(address)->sin6_addr, text.data(), text.size());
  return text.data();
}

bool is_ipv6(std::string_view address) { return address.find(':') != std::string_view::npos; }
/// fe80::/10: such an address needs the name of an interface beside it.
bool is_link_local(std::string_view address) {
  return address.starts_with("fe8") || address.starts_with("fe9") || address.starts_with("fea") || address.starts_with("feb");
}

/// The addresses of a name or of a numeric text; `status` tells why there are none.
std::unique_ptr<addrinfo, ReleaseAddresses> look_up(const std::string& host, const std::string& port, int flags, int& status) {
  addrinfo hints{};
  hints.ai_socktype = SOCK_DGRAM;
  hints.ai_flags = flags;
  addrinfo* list = nullptr;
  status = ::getaddrinfo(host.c_str(), port.empty() ? nullptr : port.c_str(), &hints, &list);
  return std::unique_ptr<addrinfo, ReleaseAddresses>(status == 0 ? list : nullptr);
}

}  // namespace

std::string TcpAddress::endpoint() const {
  const std::string place = port == 0 ? "*" : std::to_string(port);
  return is_ipv6(host) ? fmt::format("tcp://[{}]:{}", host, place) : fmt::format("tcp://{}:{}", host, place);
}

TcpAddress parse_tcp(std::string_view endpoint) {
  const auto refuse = [&](const char* problem) -> InputError {
    return {fmt::format("address '{}'", endpoint.substr(0, 80)), problem,
            "write tcp://HOST:PORT, an IPv6 address in brackets: tcp://[fd00::1]:PORT"};
  };
  if (!endpoint.starts_with(kTcp)) throw refuse("does not begin with tcp://");
  const std::string_view rest = endpoint.substr(kTcp.size());
  const std::size_t colon = rest.rfind(':');
  if (colon == std::string_view::npos || colon == 0) throw refuse("has no port or no host");
  std::string_view host = rest.substr(0, colon);
  const std::string_view port = rest.substr(colon + 1);
  const bool brackets = host.starts_with('[') && host.ends_with(']');
  if (brackets) host = host.substr(1, host.size() - 2);
  if (host.empty() || brackets != is_ipv6(host)) throw refuse("has no host");
  if (host.find_first_not_of("0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ-._:") != std::string_view::npos)
    throw refuse("has a host name with an invalid character");
  TcpAddress address{std::string(host), 0};
  if (port == "*") return address;
  const auto [end, error] = std::from_chars(port.data(), port.data() + port.size(), address.port);
  if (error != std::errc() || end != port.data() + port.size() || address.port < 1 || address.port > 65535)
    throw refuse("has a port outside 1 to 65535");
  return address;
}

bool is_numeric_address(const std::string& host) {
  int status = 0;
  return look_up(host, "", AI_NUMERICHOST, status) != nullptr;
}

bool is_loopback(std::string_view host) {
  if (host == "localhost" || host == "::1") return true;
  in_addr address{};
  return ::inet_pton(AF_INET, std::string(host).c_str(), &address) == 1 && ntohl(address.s_addr) >> 24 == 127;
}

std::string resolve(const std::string& host, std::chrono::steady_clock::time_point deadline) {
  if (is_loopback(host) || is_numeric_address(host)) return host == "localhost" ? "127.0.0.1" : host;
  while (true) {
    int status = 0;
    const auto list = look_up(host, "", AI_ADDRCONFIG, status);
    for (const addrinfo* entry = list.get(); entry != nullptr; entry = entry->ai_next) {
      std::string address = text_of(entry->ai_addr);
      if (address.empty() || is_link_local(address)) continue;
      if (is_loopback(address))
        throw InputError(host, fmt::format("resolves to {} on this machine, an address that other hosts cannot reach", address),
                         "set EARSHOT_RENDEZVOUS=tcp://ADDRESS:PORT with the address of rank 0, or correct /etc/hosts");
      return address;
    }
    if (std::chrono::steady_clock::now() >= deadline)
      throw UnknownHost(host, fmt::format("has no address: {}", status != 0 ? ::gai_strerror(status) : "neither IPv4 nor IPv6"),
                        "check the name, or set EARSHOT_RENDEZVOUS=tcp://ADDRESS:PORT with the address of rank 0");
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
  }
}

std::string local_address_towards(const TcpAddress& remote) {
  int status = 0;
  const auto list = look_up(remote.host, std::to_string(remote.port == 0 ? 9 : remote.port), AI_NUMERICHOST | AI_NUMERICSERV, status);
  if (!list) throw InputError(remote.host, "is not an IP address", "write a numeric IP address");
  const int descriptor = ::socket(list->ai_family, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (descriptor < 0) throw InputError(remote.host, std::strerror(errno), "check the network of this machine");
  sockaddr_storage local{};
  socklen_t size = sizeof(local);
  // A datagram socket that is connected has chosen its way; nothing is sent.
  const bool found = ::connect(descriptor, list->ai_addr, list->ai_addrlen) == 0 &&
                     ::getsockname(descriptor, reinterpret_cast<sockaddr*>(&local), &size) == 0;
  const int error = errno;
  ::close(descriptor);
  if (!found)
    throw InputError(remote.host, fmt::format("cannot be reached from here: {}", std::strerror(error)),
                     "check the network of this machine");
  return text_of(reinterpret_cast<const sockaddr*>(&local));
}

std::string address_of_interface(const std::string& interface, const std::string& remote) {
  ifaddrs* first = nullptr;
  if (::getifaddrs(&first) != 0) throw InputError("interfaces", std::strerror(errno), "check the network of this machine");
  const std::unique_ptr<ifaddrs, ReleaseAddresses> list(first);
  std::set<std::string> names;
  std::string ipv4, ipv6;
  for (const ifaddrs* entry = list.get(); entry != nullptr; entry = entry->ifa_next) {
    if (entry->ifa_addr == nullptr || (entry->ifa_flags & IFF_UP) == 0) continue;
    const std::string address = text_of(entry->ifa_addr);
    if (address.empty()) continue;
    names.insert(entry->ifa_name);
    if (address == interface) return address;
    if (interface != entry->ifa_name || is_link_local(address)) continue;
    std::string& of_family = is_ipv6(address) ? ipv6 : ipv4;
    if (of_family.empty()) of_family = address;
  }
  const bool want_ipv6 = remote.empty() ? ipv4.empty() : is_ipv6(remote);
  std::string& chosen = want_ipv6 ? ipv6 : ipv4;
  if (!chosen.empty()) return chosen;
  std::string all;
  for (const auto& name : names) all += (all.empty() ? "" : ", ") + name;
  throw InputError("network.interface " + interface,
                   names.contains(interface) ? fmt::format("has no {} address", want_ipv6 ? "IPv6" : "IPv4")
                                             : std::string("is neither an active network interface nor an address of this machine"),
                   "use one of " + all);
}

}  // namespace earshot
