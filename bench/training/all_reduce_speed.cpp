// SPDX-License-Identifier: Apache-2.0
#include "bench/training/all_reduce_speed.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <utility>
#include <zmq.hpp>

#include "bench/training/delayed_host.h"
#include "sim/base/errors.h"
#include "trainer/collective/gloo_exchange.h"
#include "trainer/collective/mpi/mpi_exchange.h"
#include "trainer/collective/sum_order.h"
#include "trainer/launch/transport.h"

namespace earshot {
namespace {

using Clock = std::chrono::steady_clock;

struct Way {
  std::string name;
  std::unique_ptr<Collective> workers;
};

/// tcp://127.0.0.1:PORT with a port that is free on rank 0, for all.
std::string loopback_meeting(Collective& workers) {
  std::string endpoint;
  if (workers.identity().rank == 0) {
    zmq::context_t context;
    zmq::socket_t probe(context, zmq::socket_type::router);
    probe.set(zmq::sockopt::linger, 0);
    probe.bind("tcp://127.0.0.1:*");
    endpoint = probe.get(zmq::sockopt::last_endpoint);
  }
  return workers.all_gather(endpoint)[0];
}

std::filesystem::path meeting_file(const RingConfig& config) { return config.rendezvous.substr(std::string_view("ipc://").size()); }

void add_library(std::vector<Way>& ways, const std::string& name, std::shared_ptr<WorkerExchange> exchange) {
  ways.push_back({name, make_library_collective(exchange)});
  ways.push_back({name + "_ordered", make_ordered_collective(std::move(exchange))});
}

std::vector<Way> connect_hosts(const AllReduceSpeedOptions& options, const RingConfig& config) {
  std::vector<Way> ways;
  RingConfig ring = config;
  ring.rendezvous = "tcp://" + DelayedHost::address(0) + ":29400";
  ring.network.insecure = true;  // no one else is in these namespaces
  ways.push_back({"tcp", make_zmq_ring(ring)});
  ring.rendezvous = "tcp://" + DelayedHost::address(0) + ":29401";
  if (options.gloo && built_transports().gloo) add_library(ways, "gloo", join_gloo(ring));
  return ways;
}

std::vector<Way> connect(const AllReduceSpeedOptions& options, const RingConfig& config) {
  if (options.delay_ms > 0) return connect_hosts(options, config);
  std::vector<Way> ways;
  if (options.mpi) add_library(ways, "mpi", join_mpi(config));
  if (config.identity.world_size > kMaxMeshWorkers) return ways;
  RingConfig ring = config;
  ring.network.shared_memory = true;
  ways.push_back({"shared_memory", make_zmq_ring(ring)});
  ring.network.shared_memory = false;
  ring.rendezvous = config.rendezvous + "_ipc";
  ways.push_back({"ipc", make_zmq_ring(ring)});
  ring.rendezvous = loopback_meeting(*ways.back().workers);
  ways.push_back({"tcp", make_zmq_ring(ring)});
  if (options.gloo && built_transports().gloo) add_library(ways, "gloo", join_gloo(config));
  return ways;
}

void check_sum(Way& way, std::span<float> buffer) {
  const auto [rank, world_size] = way.workers->identity();
  for (std::size_t i = 0; i < buffer.size(); ++i) buffer[i] = static_cast<float>(i % 100) * static_cast<float>(rank + 1);
  way.workers->all_reduce_sum(buffer);
  const float factor = static_cast<float>(world_size * (world_size + 1) / 2);
  for (std::size_t i = 0; i < buffer.size(); ++i)
    if (buffer[i] != static_cast<float>(i % 100) * factor)
      throw RunError(way.name, fmt::format("element {} of a sum differs from the expected value", i));
}

/// A value whose sums have other bits in another order.
float drawn_addend(int rank, std::size_t i) {
  const std::uint64_t bits = (i + 1) * 0x9E3779B97F4A7C15ull ^ static_cast<std::uint64_t>(rank + 1) * 0xD1B54A32D192ED03ull;
  return std::ldexp(static_cast<float>(static_cast<std::int32_t>(bits >> 32)), static_cast<int>(bits % 9) - 35);
}

/// Whether the sum has the bits of additions one after the other in the order of sum_order.h.
bool has_bits_of_ring(Way& way, std::span<float> buffer) {
  const auto [rank, world_size] = way.workers->identity();
  const std::size_t count = buffer.size(), stride = count / 4096 + 1;
  for (std::size_t i = 0; i < count; ++i) buffer[i] = drawn_addend(rank, i);
  way.workers->all_reduce_sum(buffer);
  bool equal = true;
  int segment = 0;
  for (std::size_t i = 0; i < count; i += stride) {
    while (i >= segment_start(count, static_cast<std::size_t>(segment) + 1, static_cast<std::size_t>(world_size))) ++segment;
    const int first = buffer.size_bytes() < kSmallSumBytes ? 0 : segment;
    float sum = drawn_addend(first, i);
    for (int k = 1; k < world_size; ++k) sum += drawn_addend((first + k) % world_size, i);
    equal = equal && sum == buffer[i];
  }
  std::ranges::fill(buffer, 0.f);  // repeated sums stay zero
  return equal;
}

double mean_ms(Collective& workers, std::span<float> buffer, int calls) {
  workers.barrier();
  const auto start = Clock::now();
  for (int call = 0; call < calls; ++call) workers.all_reduce_sum(buffer);
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count() / calls;
}

/// As many as fill the time by rank 0's clock, the same for all workers.
int number_of_calls(Collective& workers, std::span<float> buffer, double seconds) {
  const double pilot_ms = mean_ms(workers, buffer, 3);
  const double calls = std::clamp(1e3 * seconds / pilot_ms, 1.0, 1e5);
  return std::stoi(workers.all_gather(fmt::format("{:.0f}", calls))[0]);
}

}  // namespace

std::unique_ptr<Collective> connect_over_loopback(const RingConfig& config) {
  const auto over_ipc = make_zmq_ring(config);
  RingConfig ring = config;
  ring.network.shared_memory = false;
  ring.rendezvous = loopback_meeting(*over_ipc);
  auto over_tcp = make_zmq_ring(ring);
  over_ipc->barrier();  // none leaves while another still says hello there
  return over_tcp;
}

std::vector<AllReduceTime> time_all_reduce(const AllReduceSpeedOptions& options, const RingConfig& config) {
  std::optional<DelayedHost> host;
  if (options.delay_ms > 0)
    host.emplace(config.identity.rank, std::chrono::microseconds(std::lround(1e3 * options.delay_ms)), meeting_file(config).parent_path());
  std::vector<Way> ways = connect(options, config);
  std::vector<AllReduceTime> times;
  for (const std::size_t bytes : options.bytes) {
    std::vector<float> buffer(bytes / sizeof(float));
    const std::size_t first = times.size();
    std::vector<int> calls;
    for (Way& way : ways) {
      check_sum(way, buffer);
      const bool bits_of_ring = has_bits_of_ring(way, buffer);
      calls.push_back(number_of_calls(*way.workers, buffer, options.seconds));
      times.push_back({way.name, bytes, bits_of_ring, {}});
    }
    for (int round = 0; round < options.rounds; ++round)
      for (std::size_t w = 0; w < ways.size(); ++w) times[first + w].ms.push_back(mean_ms(*ways[w].workers, buffer, calls[w]));
  }
  return times;
}

}  // namespace earshot
