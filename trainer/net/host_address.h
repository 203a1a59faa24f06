// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <string>
#include <string_view>

#include "sim/base/errors.h"

namespace earshot {

/// A host name that no name server knew in time.
class UnknownHost : public InputError {
 public:
  using InputError::InputError;
};

/// "tcp://HOST:PORT" in parts; HOST without the brackets of IPv6.
struct TcpAddress {
  std::string host;
  int port = 0;  ///< 0: "*"
  [[nodiscard]] std::string endpoint() const;
};
/// Throws InputError for an invalid address: another scheme, no or a bad port, an empty host, a bare IPv6 address.
TcpAddress parse_tcp(std::string_view endpoint);

/// Whether the text names the loopback interface whatever a name server says: localhost, 127.0.0.0/8, ::1.
bool is_loopback(std::string_view host);
/// Whether the text is an IPv4 or IPv6 address, not a name.
bool is_numeric_address(const std::string& host);

/// The address of a name, IPv4 or IPv6, numeric; a name that is not known yet is asked for again until the deadline (a pod's name may
/// appear after its peers start).  Throws UnknownHost where it is not known by then, and InputError where it is an address of the loopback
/// interface, which leads no other host to us.
std::string resolve(const std::string& host, std::chrono::steady_clock::time_point deadline);

/// The address of this machine at which packets to `remote` (numeric) start.  Sends nothing.  Throws InputError without a route.
std::string local_address_towards(const TcpAddress& remote);

/// The address of an interface by its name, of the family of `remote` (numeric; empty: IPv4 before IPv6), or `interface` itself if it is
/// one of this machine's addresses.  Throws InputError that names the interfaces there are.
std::string address_of_interface(const std::string& interface, const std::string& remote);

}  // namespace earshot
