// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <string>
#include <thread>

#include "tests/support/workers/many_workers.h"

namespace earshot {

/// What one worker does in a test of a collective over MPI or Gloo, whose workers meet in files of a folder.
class ExchangeScenarios {
 public:
  using Connect = std::function<std::unique_ptr<Collective>(std::chrono::milliseconds timeout)>;
  ExchangeScenarios(WorkerIdentity identity, std::filesystem::path folder, Connect connect)
      : identity_(identity), folder_(std::move(folder)), connect_(std::move(connect)) {}

  /// Whether all was as expected.
  bool run(const std::string& name) {
    if (name == "sums") return sums();
    if (name == "messages") return messages();
    if (name == "succession") return succession();
    if (name == "killed") return killed();
    if (name == "other_size") return odd_call(false);
    if (name == "other_call") return odd_call(true);
    if (name == "slow") return slow();
    if (name == "finished") return finished();
    if (name == "waiting") return waiting();
    std::fprintf(stderr, "no scenario is called %s\n", name.c_str());
    return false;
  }

 private:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::milliseconds kLong{120'000};

  void arrive(const std::string& point) const { std::ofstream(folder_ / fmt::format("{}.{}", point, identity_.rank)).put('x'); }
  [[nodiscard]] bool has(const std::string& point, int rank) const {
    return std::filesystem::exists(folder_ / fmt::format("{}.{}", point, rank));
  }
  /// Waits until all of these ranks have arrived.
  [[nodiscard]] bool meets(const std::string& point, int first, int end) const {
    const auto start = Clock::now();
    for (int rank = first; rank < end;) {
      if (has(point, rank))
        ++rank;
      else if (seconds_since(start) > 60)
        return false;
      else
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    return true;
  }
  /// A worker that has lost the others must not end before they know: its launcher ends them then.
  bool ends_with_all(bool as_expected) const {
    if (as_expected) arrive("as_expected");
    arrive("end");
    return meets("end", 0, identity_.world_size) && as_expected;
  }

  bool sums() const {
    const SerialSums<float> floats(identity_.world_size, {0, 1, 7, 16383, 16384, 100003});
    const SerialSums<double> doubles(identity_.world_size, {5, 8191, 12345});
    const auto workers = connect_(kLong);
    return floats.equal_those_of(*workers) && doubles.equal_those_of(*workers);
  }
  bool messages() const {
    const auto workers = connect_(kLong);
    for (const std::size_t size : {0, 1, (1 << 20) + 1}) {
      const auto byte = [](std::size_t i) { return std::byte(i * 31 >> 3 & 0xFF); };
      std::vector<std::byte> bytes(size, std::byte(1));
      for (std::size_t i = 0; identity_.rank == 0 && i < size; ++i) bytes[i] = byte(i);
      workers->broadcast(bytes);
      for (std::size_t i = 0; i < size; ++i)
        if (bytes[i] != byte(i)) return false;
    }
    for (const std::size_t size : {0, 3, 300}) {
      const auto part = [&](int sender) {
        return std::string(size * static_cast<std::size_t>(sender), static_cast<char>('!' + sender % 90));
      };  // rank 0's is empty
      const auto parts = workers->all_gather(part(identity_.rank));
      if (static_cast<int>(parts.size()) != identity_.world_size) return false;
      for (int sender = 0; sender < identity_.world_size; ++sender)
        if (parts[static_cast<std::size_t>(sender)] != part(sender)) return false;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(identity_.rank % 7 * 30));
    arrive("barrier");
    workers->barrier();
    for (int rank = 0; rank < identity_.world_size; ++rank)
      if (!has("barrier", rank)) return false;
    return true;
  }
  // A worker is often one call ahead, with other sizes and types in turn.
  bool succession() const {
    const auto workers = connect_(kLong);
    for (std::size_t round = 0; round < 12; ++round) {
      const auto value = static_cast<float>(identity_.rank + 1) * static_cast<float>(round % 13);
      std::vector<float> floats(round % 3 == 1 ? 20000 : round, value);
      std::vector<double> doubles(round % 3, value);
      workers->all_reduce_sum(floats);
      workers->all_reduce_sum(doubles);
      const double expected = static_cast<double>(identity_.world_size * (identity_.world_size + 1) / 2) * static_cast<double>(round % 13);
      for (const float sum : floats)
        if (static_cast<double>(sum) != expected) return false;
      for (const double sum : doubles)
        if (sum != expected) return false;
    }
    return true;
  }
  // The last rank is lost within sums; the others fail, or their launcher ends them.
  bool killed() const {
    const auto workers = connect_(kLong);
    std::vector<float> buffer(100000);
    workers->all_reduce_sum(buffer);
    arrive("killed");
    if (identity_.rank == identity_.world_size - 1) ::kill(::getpid(), SIGKILL);
    return run_error_of([&] {
             while (true) workers->all_reduce_sum(buffer);
           }) != "no error";
  }
  bool odd_call(bool other_call) const {
    const auto workers = connect_(kLong);
    const bool odd = identity_.rank == identity_.world_size / 2;
    std::vector<float> buffer(odd && !other_call ? 8 : 7);
    const auto start = Clock::now();
    const std::string error = run_error_of([&] { odd&& other_call ? workers->barrier() : workers->all_reduce_sum(buffer); });
    return ends_with_all(tells(error, {"worker ", "calls ", "start all workers with the same program and config"}) &&
                         seconds_since(start) < 60 && tells(run_error_of([&] { workers->barrier(); }), {"worker "}));
  }
  // One that is slow and says so is waited for.  One that does not come is named by all.
  bool slow() const {
    const auto workers = connect_(std::chrono::milliseconds(3000));
    const int late = identity_.world_size / 2;
    std::vector<float> buffer(10, 1.0f);
    workers->barrier();
    const auto start = Clock::now();
    while (identity_.rank == late && seconds_since(start) < 5) {
      workers->note_progress();
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    workers->all_reduce_sum(buffer);
    if (buffer[9] != static_cast<float>(identity_.world_size)) return ends_with_all(false);
    if (identity_.rank == late) return meets("end", 0, late) && meets("end", late + 1, identity_.world_size) && ends_with_all(true);
    return ends_with_all(tells(run_error_of([&] { workers->all_reduce_sum(buffer); }),
                               {fmt::format("worker {}: did not take part in collective call 2 within 3000 ms", late)}));
  }
  bool finished() const {
    auto workers = connect_(kLong);
    const int leaves = identity_.world_size / 2;
    std::vector<float> buffer(30000, 1.0f);
    workers->all_reduce_sum(buffer);
    if (buffer[0] != static_cast<float>(identity_.world_size)) return ends_with_all(false);
    if (identity_.rank == leaves) {
      arrive("as_expected");
      arrive("end");
      return true;  // leaves in peace
    }
    return ends_with_all(tells(run_error_of([&] { workers->barrier(); }), {fmt::format("worker {}: has finished", leaves)}));
  }
  // Preemption asks this after each step.
  bool waiting() const {
    const auto workers = connect_(kLong);
    const int waiting = identity_.world_size / 2;
    workers->barrier();
    if (identity_.rank < waiting) {
      workers->barrier();
      return true;
    }
    int count = 0;
    const auto start = Clock::now();
    while (count < waiting && seconds_since(start) < 60) {
      count = workers->num_waiting();
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    arrive("informed");
    while (!meets("informed", waiting, identity_.world_size))
      if (workers->num_waiting() > waiting) return false;
    workers->barrier();
    if (count != waiting) std::fprintf(stderr, "worker %d has heard of %d\n", identity_.rank, count);
    return count == waiting;
  }

  WorkerIdentity identity_;
  std::filesystem::path folder_;
  Connect connect_;
};

}  // namespace earshot
