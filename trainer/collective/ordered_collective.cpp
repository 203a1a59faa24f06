// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <cstring>
#include <utility>
#include <vector>

#include "sim/base/errors.h"
#include "trainer/collective/abandon_on_error.h"
#include "trainer/collective/sum_order.h"
#include "trainer/collective/worker_exchange.h"

namespace earshot {
namespace {

class OrderedCollective : public Collective {
 public:
  explicit OrderedCollective(std::shared_ptr<WorkerExchange> exchange) : exchange_(std::move(exchange)) {}

  [[nodiscard]] WorkerIdentity identity() const override { return exchange_->identity(); }
  void all_reduce_sum(std::span<float> buffer) override { all_reduce(Operation::all_reduce_float, buffer); }
  void all_reduce_sum(std::span<double> buffer) override { all_reduce(Operation::all_reduce_double, buffer); }
  void broadcast(std::span<std::byte> buffer) override {
    call(Operation::broadcast, buffer.size(), [&] { exchange_->broadcast(buffer); });
  }
  void barrier() override {
    call(Operation::barrier, 0, [] {});
  }
  std::vector<std::string> all_gather(const std::string& bytes) override {
    std::vector<std::string> parts;
    call(Operation::all_gather, 0, [&] {
      if (bytes.size() > kMaxGatherBytes)
        throw RunError("all_gather", fmt::format("{} bytes exceed the limit of {}", bytes.size(), kMaxGatherBytes));
      std::vector<std::uint64_t> sizes(world());
      sizes[rank()] = bytes.size();
      exchange_->all_gather(std::as_writable_bytes(std::span(sizes)), equal_parts(sizeof(std::uint64_t)));
      std::vector<std::size_t> starts(world() + 1);
      for (std::size_t part = 0; part < world(); ++part) starts[part + 1] = starts[part] + sizes[part];
      std::vector<std::byte> all(starts.back());
      if (!bytes.empty()) std::memcpy(all.data() + starts[rank()], bytes.data(), bytes.size());
      if (!all.empty()) exchange_->all_gather(all, starts);
      for (std::size_t part = 0; part < world(); ++part)
        parts.emplace_back(reinterpret_cast<const char*>(all.data()) + starts[part], sizes[part]);
    });
    return parts;
  }
  void note_progress() override { exchange_->note_progress(); }
  [[nodiscard]] int num_waiting() override { return exchange_->num_waiting(); }

 protected:
  template <class Body>
  void call(Operation operation, std::size_t bytes, const Body& body) {
    abandon_on_error(*exchange_, [&] {
      exchange_->begin(operation, bytes);
      body();
    });
  }
  WorkerExchange& exchange() { return *exchange_; }

 private:
  [[nodiscard]] std::size_t world() const { return static_cast<std::size_t>(identity().world_size); }
  [[nodiscard]] std::size_t rank() const { return static_cast<std::size_t>(identity().rank); }
  [[nodiscard]] std::vector<std::size_t> equal_parts(std::size_t bytes) const {
    std::vector<std::size_t> starts(world() + 1);
    for (std::size_t part = 0; part <= world(); ++part) starts[part] = part * bytes;
    return starts;
  }
  template <class T>
  void all_reduce(Operation operation, std::span<T> buffer) {
    call(operation, buffer.size_bytes(), [&] {
      if (buffer.empty()) return;
      std::vector<std::size_t> starts(world() + 1);
      for (std::size_t segment = 0; segment <= world(); ++segment)
        starts[segment] = segment_start(buffer.size(), segment, world()) * sizeof(T);
      const std::size_t first = starts[rank()] / sizeof(T), count = starts[rank() + 1] / sizeof(T) - first;
      received_.resize(world() * count * sizeof(T));
      exchange_->all_to_all(std::as_bytes(buffer), starts, received_);
      const T* const addends = reinterpret_cast<const T*>(received_.data());
      sum_in_order(buffer.data() + first, first, count, buffer.size(), identity().world_size,
                   [&](int sender) { return addends + static_cast<std::size_t>(sender) * count; });
      exchange_->all_gather(std::as_writable_bytes(buffer), starts);
    });
  }

  std::shared_ptr<WorkerExchange> exchange_;
  std::vector<std::byte> received_;  ///< [world_size, bytes of the own segment]
};

class LibraryCollective : public OrderedCollective {
 public:
  using OrderedCollective::OrderedCollective;
  void all_reduce_sum(std::span<float> buffer) override { exchange().library_sum(buffer); }
};

}  // namespace

std::unique_ptr<Collective> make_ordered_collective(std::shared_ptr<WorkerExchange> exchange) {
  return std::make_unique<OrderedCollective>(std::move(exchange));
}

std::unique_ptr<Collective> make_library_collective(std::shared_ptr<WorkerExchange> exchange) {
  return std::make_unique<LibraryCollective>(std::move(exchange));
}

}  // namespace earshot
