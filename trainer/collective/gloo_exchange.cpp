// SPDX-License-Identifier: Apache-2.0
#include "trainer/collective/gloo_exchange.h"

#include "sim/base/errors.h"

#ifdef EARSHOT_GLOO
#define USE_C10D_GLOO  // without it c10d's header declares nothing
#include <fmt/format.h>
#include <torch/torch.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <exception>
#include <optional>
#include <torch/csrc/distributed/c10d/FileStore.hpp>
#include <torch/csrc/distributed/c10d/PrefixStore.hpp>
#include <torch/csrc/distributed/c10d/ProcessGroupGloo.hpp>
#include <torch/csrc/distributed/c10d/TCPStore.hpp>
#include <utility>
#include <vector>

#include "sim/base/files.h"
#include "sim/base/process/exit_codes.h"
#include "sim/base/text/listed.h"
#include "trainer/net/host_address.h"
#endif

namespace earshot {

#ifdef EARSHOT_GLOO
namespace {

using Clock = std::chrono::steady_clock;
constexpr std::string_view kIpc = "ipc://";
constexpr std::chrono::milliseconds kBetweenCounts{50};

using StorePointer = c10::intrusive_ptr<c10d::Store>;

/// c10's errors go on with the calls that led to them.
std::string first_line(const std::exception& error) {
  const std::string_view text = error.what();
  return std::string(text.substr(0, text.find('\n')));
}

StorePointer open_store(const RingConfig& config) {
  const auto [rank, world_size] = config.identity;
  StorePointer store;
  // The file of a killed start stays: no other start may read it.
  const std::string start = fmt::format("{} {}", config.run_id, config.start_id);
  if (config.rendezvous.starts_with(kIpc)) {
    const std::string file = fmt::format("{}.gloo.{}", config.rendezvous.substr(kIpc.size()), hex64(hash64(start)));
    store = c10::make_intrusive<c10d::FileStore>(file, world_size);
  } else {
    const TcpAddress meeting_point = parse_tcp(config.rendezvous);
    c10d::TCPStoreOptions options;
    options.port = static_cast<std::uint16_t>(meeting_point.port);
    options.isServer = rank == 0;
    options.waitWorkers = false;
    options.timeout = config.timeout;
    try {
      store = c10::make_intrusive<c10d::TCPStore>(meeting_point.host, options);
    } catch (const std::exception& error) {
      if (rank == 0) throw;  // it cannot listen there
      throw WorldIncomplete(fmt::format("rendezvous {}", config.rendezvous), first_line(error));
    }
  }
  return c10::make_intrusive<c10d::PrefixStore>("earshot " + start, store);
}

/// Where this worker listens, and whether others can reach that.
std::string address_of(const RingConfig& config) {
  if (config.rendezvous.starts_with(kIpc)) return "127.0.0.1";
  const TcpAddress meeting_point = parse_tcp(config.rendezvous);
  if (is_loopback(meeting_point.host)) return "127.0.0.1";
  if (!config.network.insecure)
    throw InputError("network.collective = gloo", "connects several hosts without encryption and keys",
                     "use --insecure-network on a network that you trust, or network.collective=zeromq with keys");
  const TcpAddress remote{resolve(meeting_point.host, Clock::now() + config.timeout), meeting_point.port};
  return config.network.interface.empty() ? local_address_towards(remote) : address_of_interface(config.network.interface, remote.host);
}

class GlooExchange : public WorkerExchange {
 public:
  explicit GlooExchange(const RingConfig& config) : identity_(config.identity), exceptions_at_start_(std::uncaught_exceptions()) {
    const auto options = c10d::ProcessGroupGloo::Options::create(config.timeout);
    options->devices = {c10d::ProcessGroupGloo::createDeviceForHostname(address_of(config))};
    options->threads = 2;
    store_ = open_store(config);
    try {
      group_ = c10::make_intrusive<c10d::ProcessGroupGloo>(store_, identity_.rank, identity_.world_size, options);
    } catch (const std::exception& error) {
      throw WorldIncomplete("Gloo", fmt::format("not all workers connected: {}", first_line(error)));
    }
  }
  ~GlooExchange() override {
    if (!abandoned_ && std::uncaught_exceptions() > exceptions_at_start_) abandon("an error");
  }

  [[nodiscard]] WorkerIdentity identity() const override { return identity_; }

  void begin(Operation operation, std::size_t bytes) override {
    if (abandoned_) throw RunError("Gloo", *abandoned_);
    struct Call {
      std::uint64_t operation, bytes;
      bool operator==(const Call&) const = default;
    };
    std::vector<Call> calls(static_cast<std::size_t>(identity_.world_size));
    const Call own{static_cast<std::uint64_t>(operation), bytes};
    calls[static_cast<std::size_t>(identity_.rank)] = own;
    ++opened_;
    num_waiting_ = 0;  // the last count was for the call before
    counted_at_ = {};
    ask_store([&] {
      store_->add("begun", 1);
      return store_->add(fmt::format("begun by {}", identity_.rank), 1);
    });
    std::vector<std::size_t> starts(calls.size() + 1);
    for (std::size_t rank = 0; rank < starts.size(); ++rank) starts[rank] = rank * sizeof(Call);
    all_gather(std::as_writable_bytes(std::span(calls)), starts);
    const auto odd = std::ranges::find_if(calls, [&](const Call& call) { return call != own; });
    if (odd == calls.end()) return;
    throw RunError(worker_name(static_cast<int>(odd - calls.begin())),
                   fmt::format("calls {} with {} bytes, but this worker calls {} with {} bytes; start all workers with the same program "
                               "and config",
                               name_of(static_cast<Operation>(odd->operation)), odd->bytes, name_of(operation), bytes));
  }

  void all_to_all(std::span<const std::byte> sent, std::span<const std::size_t> starts, std::span<std::byte> received) override {
    std::vector<std::int64_t> sizes_sent,
        sizes_received(starts.size() - 1, static_cast<std::int64_t>(received.size() / (starts.size() - 1)));
    for (std::size_t p = 0; p + 1 < starts.size(); ++p) sizes_sent.push_back(static_cast<std::int64_t>(starts[p + 1] - starts[p]));
    // c10d reads it only.
    torch::Tensor input = of_bytes({const_cast<std::byte*>(sent.data()), sent.size()}), output = of_bytes(received);
    call([&] { return group_->alltoall_base(output, input, sizes_received, sizes_sent); });
  }
  /// Gloo gathers parts of one size: the longest.
  void all_gather(std::span<std::byte> buffer, std::span<const std::size_t> starts) override {
    std::size_t longest = 1;
    for (std::size_t p = 0; p + 1 < starts.size(); ++p) longest = std::max(longest, starts[p + 1] - starts[p]);
    const auto room = static_cast<std::int64_t>(longest);
    const auto part = [&](std::size_t p) { return buffer.subspan(starts[p], starts[p + 1] - starts[p]); };
    const auto rank = static_cast<std::size_t>(identity_.rank);
    std::vector<torch::Tensor> inputs{torch::zeros({room}, torch::kUInt8)};
    std::memcpy(inputs[0].data_ptr(), part(rank).data(), part(rank).size());
    std::vector<std::vector<torch::Tensor>> outputs(1);
    for (std::size_t p = 0; p + 1 < starts.size(); ++p) outputs[0].push_back(torch::empty({room}, torch::kUInt8));
    call([&] { return group_->allgather(outputs, inputs); });
    for (std::size_t p = 0; p + 1 < starts.size(); ++p) std::memcpy(part(p).data(), outputs[0][p].data_ptr(), part(p).size());
  }
  void broadcast(std::span<std::byte> buffer) override {
    if (buffer.empty()) return;
    std::vector<torch::Tensor> tensors{of_bytes(buffer)};
    call([&] { return group_->broadcast(tensors); });
  }
  void library_sum(std::span<float> buffer) override {
    std::vector<torch::Tensor> tensors{torch::from_blob(buffer.data(), {static_cast<std::int64_t>(buffer.size())}, torch::kFloat32)};
    call([&] { return group_->allreduce(tensors); });
  }

  void note_progress() override {}
  /// From a counter of all begun calls in the store, asked for at most every 50 ms.
  int num_waiting() override {
    if (abandoned_ || Clock::now() - counted_at_ < kBetweenCounts) return num_waiting_;
    counted_at_ = Clock::now();
    const auto begun = ask_store([&] { return store_->add("begun", 0); });
    num_waiting_ = static_cast<int>(begun - static_cast<std::int64_t>(opened_) * identity_.world_size);
    return num_waiting_;
  }

  void abandon(const std::string& reason) override {
    if (abandoned_) return;
    abandoned_ = reason;
    const std::string text = fmt::format("{}\n{}", identity_.rank, reason);
    try {
      if (!store_->check({"stopped"})) store_->set("stopped", std::vector<std::uint8_t>(text.begin(), text.end()));
    } catch (const std::exception&) {  // the store is gone: the others see the end of the connections
    }
    group_.reset();
  }

 private:
  static torch::Tensor of_bytes(std::span<std::byte> bytes) {
    return torch::from_blob(bytes.data(), {static_cast<std::int64_t>(bytes.size())}, torch::kUInt8);
  }
  template <class Ask>
  std::int64_t ask_store(const Ask& ask) {
    try {
      return ask();
    } catch (const std::exception& error) {
      throw WorldLost("Gloo", fmt::format("its store does not answer: {}", first_line(error)));
    }
  }
  template <class Start>
  void call(const Start& start) {
    try {
      start()->wait();
    } catch (const std::exception& error) {
      explain(first_line(error));
    }
  }
  /// Who has ended the run, or has not come, by the store; else what Gloo says.
  [[noreturn]] void explain(const std::string& text) {
    std::vector<int> missing;
    std::string stopped;
    try {
      if (store_->check({"stopped"})) {
        const std::vector<std::uint8_t> bytes = store_->get("stopped");
        stopped.assign(bytes.begin(), bytes.end());
      }
      for (int rank = 0; rank < identity_.world_size; ++rank)
        if (store_->add(fmt::format("begun by {}", rank), 0) < static_cast<std::int64_t>(opened_)) missing.push_back(rank);
    } catch (const std::exception&) {
      stopped.clear(), missing.clear();
    }
    const auto end_of_rank = stopped.find('\n');
    if (end_of_rank != std::string::npos)
      throw WorldLost("worker " + stopped.substr(0, end_of_rank), "stopped the run: " + stopped.substr(end_of_rank + 1));
    if (!missing.empty())
      throw WorldLost(fmt::format("worker {}", listed(missing, ", ")),
                      fmt::format("did not take part in collective call {}: {}", opened_ - 1, text));
    throw WorldLost("Gloo", text);
  }

  WorkerIdentity identity_;
  int exceptions_at_start_;
  StorePointer store_;
  c10::intrusive_ptr<c10d::ProcessGroupGloo> group_;
  std::uint64_t opened_ = 0;  ///< calls that this worker has begun
  int num_waiting_ = 0;
  Clock::time_point counted_at_;
  std::optional<std::string> abandoned_;
};

}  // namespace

std::shared_ptr<WorkerExchange> join_gloo(const RingConfig& config) {
  try {
    return std::make_shared<GlooExchange>(config);
  } catch (const InputError&) {
    throw;
  } catch (const RunError&) {
    throw;
  } catch (const std::exception& error) {
    throw RunError("Gloo", first_line(error));
  }
}
#else
std::shared_ptr<WorkerExchange> join_gloo(const RingConfig&) {
  throw InputError("network.collective = gloo", "Gloo is not part of this build", "install libgloo-dev and build again");
}
#endif

}  // namespace earshot
