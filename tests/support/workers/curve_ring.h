// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>
#include <zmq.hpp>

#include "sim/base/files.h"
#include "tests/support/workers/worker_processes.h"
#include "trainer/collective/collective.h"

namespace earshot {

/// Holds the port against other tests until this process ends; false if another test or program has it.
inline bool hold_port(int port, const std::string& host) {
  // An abstract address is held by one process, and given up with it.
  sockaddr_un address{.sun_family = AF_UNIX, .sun_path = {}};
  const std::string name = "earshot-test-port-" + std::to_string(port);
  std::ranges::copy(name, address.sun_path + 1);
  const int holder = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + name.size());
  if (::bind(holder, reinterpret_cast<const sockaddr*>(&address), size) != 0) {
    ::close(holder);
    return false;
  }
  try {
    zmq::context_t context;
    zmq::socket_t(context, zmq::socket_type::router).bind("tcp://" + host + ":" + std::to_string(port));
    return true;
  } catch (const zmq::error_t&) {  // of another program; it stays held
    return false;
  }
}

/// The first of so many ports in a row that nothing listens on, and that no other test gets until this process ends.  Below those that a
/// system gives by itself, so that no connection takes them either.
inline int free_ports(int wanted, const std::string& host = "127.0.0.1") {
  constexpr int first = 25000, count = 4000;
  const int start = ::getpid() * 37 % count;
  int in_a_row = 0;
  for (int i = 0; i < count; ++i) {
    const int offset = (start + i) % count;
    if (offset == 0) in_a_row = 0;
    in_a_row = hold_port(first + offset, host) ? in_a_row + 1 : 0;
    if (in_a_row == wanted) return first + offset - wanted + 1;
  }
  throw std::runtime_error("no port is free");
}
inline int free_port(const std::string& host = "127.0.0.1") { return free_ports(1, host); }

/// A worker of a run that meets at host:port with the keys of a file.
inline RingConfig curve_ring(const std::string& host, int port, int rank, int world_size, const std::filesystem::path& key_file) {
  RingConfig config;
  config.identity = {rank, world_size};
  config.rendezvous = "tcp://" + host + ":" + std::to_string(port);
  config.run_id = "test-run";
  config.timeout = std::chrono::milliseconds(20000);
  config.network.curve_key_file = key_file.string();
  return config;
}

/// Hash of all that a few calls give: sums in one hop and round the ring, a broadcast, a gather.  Another order of summation gives another.
inline std::uint64_t hash_of_calls(Collective& collective) {
  const int rank = collective.identity().rank;
  std::uint64_t hash = 0;
  for (const std::size_t count : {7, 1000, 100003, 700001}) {
    std::vector<float> buffer(count);
    for (std::size_t i = 0; i < count; ++i)
      buffer[i] = static_cast<float>(
          std::ldexp(std::sin(static_cast<double>(i * 31 + static_cast<std::size_t>(rank) * 7919)), static_cast<int>(i % 9)));
    collective.all_reduce_sum(std::span<float>(buffer));
    hash = hash64(std::as_bytes(std::span(buffer)), hash);
  }
  std::vector<std::byte> bytes(3000, std::byte(rank + 1));
  collective.broadcast(bytes);
  hash = hash64(bytes, hash);
  for (const auto& part : collective.all_gather(std::string(2000000, static_cast<char>('a' + rank)))) hash = hash64(part, hash);
  collective.barrier();
  return hash;
}

}  // namespace earshot
