// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fcntl.h>
#include <sched.h>
#include <unistd.h>

#include <cstdlib>
#include <string>
#include <vector>

namespace earshot {

/// Hosts on one machine: network namespaces, each with a veth to a bridge in a namespace of its own, so that nothing of this machine's
/// network is touched.  Host i has 10.77.0.(i+1)/24 and fd77::(i+1)/64 on eth0.  Needs root and iproute2; gone at the end of the test.
class HostNamespaces {
 public:
  explicit HostNamespaces(int count) : prefix_("earshot" + std::to_string(::getpid()) + "-") {
    if (::geteuid() != 0) {
      missing_ = "network namespaces need root";
      return;
    }
    bool made = run("ip netns add " + name_of_switch()) && run(inside(name_of_switch()) + "ip link add br0 type bridge") &&
                run(inside(name_of_switch()) + "ip link set br0 up");
    for (int host = 0; host < count && made; ++host) {
      const std::string name = name_of(host), port = "port" + std::to_string(host), number = std::to_string(host + 1);
      hosts_.push_back(name);
      made = run("ip netns add " + name) &&
             run(inside(name_of_switch()) + "ip link add " + port + " type veth peer name eth0 netns " + name) &&
             run(inside(name_of_switch()) + "ip link set " + port + " master br0 up") && run(inside(name) + "ip link set lo up") &&
             run(inside(name) + "ip address add 10.77.0." + number + "/24 dev eth0") && run(inside(name) + "ip link set eth0 up");
      if (made) run(inside(name) + "ip address add fd77::" + number + "/64 dev eth0 nodad");
    }
    if (!made) missing_ = "this machine gives no network namespaces with veth and bridge (ip, of iproute2)";
  }
  ~HostNamespaces() {
    for (const auto& host : hosts_) run("ip netns delete " + host);
    if (::geteuid() == 0) run("ip netns delete " + name_of_switch());
  }
  HostNamespaces(const HostNamespaces&) = delete;
  HostNamespaces& operator=(const HostNamespaces&) = delete;

  /// Reason why hosts are unavailable; empty if they are available.
  [[nodiscard]] const std::string& missing() const { return missing_; }
  [[nodiscard]] static std::string address(int host) { return "10.77.0." + std::to_string(host + 1); }
  [[nodiscard]] static std::string address_ipv6(int host) { return "[fd77::" + std::to_string(host + 1) + "]"; }
  /// Moves the calling process, which has one thread, into the host.
  [[nodiscard]] bool enter(int host) const {
    const int descriptor = ::open(("/run/netns/" + name_of(host)).c_str(), O_RDONLY | O_CLOEXEC);
    const bool entered = descriptor >= 0 && ::setns(descriptor, CLONE_NEWNET) == 0;
    if (descriptor >= 0) ::close(descriptor);
    return entered;
  }
  /// Prefix of a shell command that is to run there.
  [[nodiscard]] std::string on(int host) const { return inside(name_of(host)); }
  /// Pulls the cable of a host, or puts it back.
  void set_link(int host, bool up) const {
    run(inside(name_of_switch()) + "ip link set port" + std::to_string(host) + (up ? " up" : " down"));
  }
  /// Delay and loss of what the host sends, as `tc netem` takes them; false where the kernel has no netem.
  [[nodiscard]] bool disturb(int host, const std::string& disturbance) const {
    return run(on(host) + "tc qdisc add dev eth0 root netem " + disturbance);
  }

 private:
  [[nodiscard]] std::string name_of(int host) const { return prefix_ + std::to_string(host); }
  [[nodiscard]] std::string name_of_switch() const { return prefix_ + "switch"; }
  static std::string inside(const std::string& name) { return "ip netns exec " + name + " "; }
  static bool run(const std::string& command) { return std::system((command + " >/dev/null 2>&1").c_str()) == 0; }

  std::string prefix_, missing_;
  std::vector<std::string> hosts_;
};

}  // namespace earshot
