// SPDX-License-Identifier: Apache-2.0
#include "trainer/collective/hierarchical_sum.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <utility>

#include "sim/base/errors.h"
#include "trainer/collective/sum_order.h"

namespace earshot {
namespace {

constexpr std::size_t kChunk = 512 * 1024;  // bytes of one visit, and of one message
constexpr int kLeaderAdds = 4;              // workers of a host whose leader adds up alone

/// sum[0, count) += addends, element by element.
template <class T>
void add(T* sum, const T* addends, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) sum[i] += addends[i];
}

/// sum[0, count) = message + addends.  The message may lie at any address.
template <class T>
void add_to_message(T* sum, const T* addends, const std::byte* message, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    T value;
    std::memcpy(&value, message + i * sizeof(T), sizeof(T));
    sum[i] = value + addends[i];
  }
}

}  // namespace

// Layout: a counter per worker, then two buffers of a slot per worker and one slot of sums.
std::size_t HierarchicalSum::bytes_for(int num_workers) {
  return SharedProgress::bytes_for(num_workers) + 2 * (static_cast<std::size_t>(num_workers) + 1) * kChunk;
}

HierarchicalSum::HierarchicalSum(PeerMesh& mesh, HostLayout layout, std::optional<SharedMemory> memory)
    : mesh_(mesh), layout_(std::move(layout)), host_(layout_.host_of(mesh.identity().rank)), memory_(std::move(memory)) {
  const auto first_of = [this](int host) {
    const int num_hosts = layout_.num_hosts();
    return layout_.first[static_cast<std::size_t>((host + num_hosts) % num_hosts)];
  };
  const int rank = mesh.identity().rank, first = first_of(host_);
  local_ = {rank - first, layout_.num_workers(host_)};
  if (local_.world_size > 1) {
    EARSHOT_EXPECT(memory_ && memory_->bytes().size() == bytes_for(local_.world_size));
    workers_.emplace(memory_->bytes().first(SharedProgress::bytes_for(local_.world_size)), local_, first);
  }
  if (leads())
    mesh_.link_bulk(first_of(host_ + 1), first_of(host_ - 1));
  else
    mesh_.link_bulk(rank, rank);
}

/// Of the buffer of the present visit; place world_size is that of the sums.
std::byte* HierarchicalSum::slot(int place) const {
  const auto world = static_cast<std::size_t>(local_.world_size);
  return memory_->bytes().data() + SharedProgress::bytes_for(local_.world_size) +
         (parity() * (world + 1) + static_cast<std::size_t>(place)) * kChunk;
}

template <class Body>
void HierarchicalSum::for_own_segments(std::size_t from, std::size_t to, std::size_t total, Body&& body) const {
  const auto world = static_cast<std::size_t>(layout_.first.back());
  const auto first = static_cast<std::size_t>(layout_.first[static_cast<std::size_t>(host_)]);
  for (int k = 0; k < local_.world_size; ++k) {
    const std::size_t segment = first + static_cast<std::size_t>(k);
    const std::size_t begin = std::max(from, segment_start(total, segment, world));
    const std::size_t end = std::min(to, segment_start(total, segment + 1, world));
    if (begin < end) body(begin, end, k);
  }
}

/// The leader has its own addend in its buffer, the others' are in their slots.
template <class T>
void HierarchicalSum::add_as_leader(const HostRing::Visit& visit, std::span<T> buffer, const zmq::message_t* came, T* target) const {
  T* const own_values = buffer.data() + visit.first;
  if (visit.work == HostRing::Work::copy) {
    std::memcpy(target, came->data(), visit.count * sizeof(T));
    return;
  }
  // [begin, end): the addends of the places from `from` to `to` - 1, onto what came if anything did.
  const auto add_range = [&](std::size_t begin, std::size_t end, int from, int to) {
    for (std::size_t block = begin; block < end; block += kSumBlock) {
      const std::size_t length = std::min(kSumBlock, end - block), offset = block - visit.first;
      T* const sum = target + offset;
      if (came != nullptr)  // the leader's is the first addend
        add_to_message(sum, own_values + offset, static_cast<const std::byte*>(came->data()) + offset * sizeof(T), length);
      else if (from > 0)
        std::memcpy(sum, slot_at<T>(from, visit, block), length * sizeof(T));
      for (int addend = from + 1; addend < to; ++addend) add(sum, slot_at<T>(addend, visit, block), length);
    }
  };
  if (visit.work == HostRing::Work::add) return add_range(visit.first, visit.first + visit.count, 0, local_.world_size);
  const bool begins = visit.work == HostRing::Work::begin;
  for_own_segments(visit.first, visit.first + visit.count, buffer.size(), [&](std::size_t begin, std::size_t end, int k) {
    add_range(begin, end, begins ? k : 0, begins ? local_.world_size : k);
  });
}

template <class T>
void HierarchicalSum::visit_by_leader(const HostRing::Visit& visit, std::span<T> buffer, const zmq::message_t* came, T* target,
                                      const SharedProgress::Check& look) {
  const bool adds = visit.work != HostRing::Work::copy;
  const std::size_t bytes = visit.count * sizeof(T);
  const int sums = local_.world_size;
  if (leads()) {
    workers_->wait_for_all(progress_ + (adds ? 1 : -2), look);  // -2: they have read the results of the last visit but one
    add_as_leader(visit, buffer, came, target);
    if (visit.completes) std::memcpy(slot(sums), target, bytes);
  } else {
    workers_->wait_for(0, progress_ - 2, look);  // the leader has read the addends of the last visit but one
    if (adds) std::memcpy(slot(local_.rank), buffer.data() + visit.first, bytes);
    workers_->announce(progress_ + 1);
    if (visit.completes) {
      workers_->wait_for(0, progress_ + 2, look);
      std::memcpy(target, slot(sums), bytes);
    }
  }
  workers_->announce(progress_ + 2);
}

/// This worker's part of the chunk: the sums and all addends are in their slots.
template <class T>
void HierarchicalSum::add_part(const HostRing::Visit& visit, std::size_t total) const {
  const auto num_local = static_cast<std::size_t>(local_.world_size), place = static_cast<std::size_t>(local_.rank);
  const std::size_t part_begin = visit.first + segment_start(visit.count, place, num_local);
  const std::size_t part_end = visit.first + segment_start(visit.count, place + 1, num_local);
  const auto add_range = [&](std::size_t begin, std::size_t end, int from, int to, bool onto_nothing) {
    for (std::size_t block = begin; block < end; block += kSumBlock) {
      const std::size_t length = std::min(kSumBlock, end - block);
      T* const sum = slot_at<T>(local_.world_size, visit, block);
      if (onto_nothing) std::memcpy(sum, slot_at<T>(from, visit, block), length * sizeof(T));
      for (int addend = from + (onto_nothing ? 1 : 0); addend < to; ++addend) add(sum, slot_at<T>(addend, visit, block), length);
    }
  };
  if (visit.work == HostRing::Work::add) return add_range(part_begin, part_end, 0, local_.world_size, false);
  const bool begins = visit.work == HostRing::Work::begin;
  for_own_segments(part_begin, part_end, total, [&](std::size_t begin, std::size_t end, int k) {
    add_range(begin, end, begins ? k : 0, begins ? local_.world_size : k, begins);
  });
}

template <class T>
void HierarchicalSum::visit_by_all(const HostRing::Visit& visit, std::span<T> buffer, const zmq::message_t* came, T* target,
                                   const SharedProgress::Check& look) {
  const bool adds = visit.work != HostRing::Work::copy;
  const std::size_t bytes = visit.count * sizeof(T);
  const int sums = local_.world_size;
  // Slots are written again two visits later.  By then every worker has announced the visit between, which it does only when it has read
  // all it needs of this one.
  if (adds) std::memcpy(slot(local_.rank), buffer.data() + visit.first, bytes);
  if (came != nullptr) std::memcpy(slot(sums), came->data(), bytes);
  workers_->announce(progress_ + 1);
  workers_->wait_for_all(progress_ + 1, look);
  if (adds) {
    add_part<T>(visit, buffer.size());
    workers_->announce(progress_ + 2);
    if (leads() || visit.completes) workers_->wait_for_all(progress_ + 2, look);
  }
  if (leads() || visit.completes) std::memcpy(target, slot(sums), bytes);
  if (!adds) workers_->announce(progress_ + 2);
}

void HierarchicalSum::check(Operation operation, std::size_t bytes, int awaited) {
  while (const auto frame = mesh_.receive_control())
    throw RunError(
        worker_name(frame->from),
        fmt::format("calls {} with {} bytes, but this worker calls {} with {} bytes; start all workers with the same program and config",
                    name_of(frame->header.operation), frame->header.total, name_of(operation), bytes));
  mesh_.check(awaited);
}

/// Sends what the queue takes; true once nothing is due.  A chunk that libzmq still reads is never written: it comes back only after the
/// next host has read our part.
bool HierarchicalSum::send_due(Operation operation, std::size_t element_bytes, std::size_t total) {
  while (!due_.empty()) {
    const auto& [visit, data] = due_.front();
    FrameHeader header;
    header.operation = operation;
    header.phase = visit.completes ? 1 : 0;
    header.step = visit.step;
    header.offset = visit.first * element_bytes;
    header.total = total;
    if (!mesh_.send_bulk(header, {data, visit.count * element_bytes})) return false;
    due_.pop_front();
  }
  return true;
}

/// The chunk from the previous host for this visit.
template <class T>
PeerMesh::Frame HierarchicalSum::next_frame(Operation operation, std::span<T> buffer, const HostRing::Visit& visit) {
  PeerMesh::Interest interest;
  interest.awaited = {mesh_.left()};
  interest.bulk_data = true;
  while (true) {
    interest.bulk_queue_full = !send_due(operation, sizeof(T), buffer.size_bytes());
    if (auto frame = mesh_.receive_bulk()) {
      const FrameHeader& header = frame->header;
      if (header.operation != operation || header.total != buffer.size_bytes())
        throw RunError(
            worker_name(frame->from),
            fmt::format(
                "calls {} with {} bytes, but this worker calls {} with {} bytes; start all workers with the same program and config",
                name_of(header.operation), header.total, name_of(operation), buffer.size_bytes()));
      if (header.step + 1 != visit.step || header.offset != visit.first * sizeof(T) || header.length != visit.count * sizeof(T) ||
          (header.phase == 1) != (visit.work == HostRing::Work::copy))
        throw RunError(worker_name(frame->from), "sends the wrong part of the buffer");
      return std::move(*frame);
    }
    while (const auto frame = mesh_.receive_control())
      throw RunError(worker_name(frame->from),
                     fmt::format("calls {}, but this worker calls {}", name_of(frame->header.operation), name_of(operation)));
    mesh_.wait(interest);
  }
}

template <class T>
void HierarchicalSum::sum_chunks(Operation operation, std::span<T> buffer) {
  const auto visits = HostRing(layout_, buffer.size(), kChunk / sizeof(T)).visits(host_);
  const auto look = [&](int awaited) { check(operation, buffer.size_bytes(), awaited); };
  due_.clear();
  // The leader's own addend of such a chunk comes last, so that its buffer has to keep it.
  const auto starts_without_own_values = [](const HostRing::Visit& visit) {
    return visit.work == HostRing::Work::begin && !visit.of_first_segment;
  };
  std::size_t begun = 0;  // bytes
  if (leads()) {
    for (const HostRing::Visit& visit : visits) begun += starts_without_own_values(visit) ? visit.count * sizeof(T) : 0;
    begun_.resize(begun);
    begun = 0;
  }
  if (workers_) {
    workers_->state_call(parity(), operation, buffer.size_bytes());
    workers_->announce(progress_ + 2);
    workers_->wait_for_all(progress_ + 2, look);
    workers_->compare_calls(parity(), operation, buffer.size_bytes());
    progress_ += 2;
  }

  for (const HostRing::Visit& visit : visits) {
    const bool starts_on_this_host = leads() && starts_without_own_values(visit);
    T* const target = starts_on_this_host ? reinterpret_cast<T*>(begun_.data() + begun) : buffer.data() + visit.first;
    if (starts_on_this_host) begun += visit.count * sizeof(T);
    std::optional<PeerMesh::Frame> frame;
    if (leads() && visit.work != HostRing::Work::begin) frame = next_frame(operation, buffer, visit);
    const zmq::message_t* const came = frame ? &frame->payload : nullptr;
    if (!workers_) {
      add_as_leader(visit, buffer, came, target);
    } else {
      if (local_.world_size <= kLeaderAdds)
        visit_by_leader(visit, buffer, came, target, look);
      else
        visit_by_all(visit, buffer, came, target, look);
      progress_ += 2;
    }
    if (leads() && visit.goes_on) {
      due_.push_back({visit, reinterpret_cast<const std::byte*>(target)});
      send_due(operation, sizeof(T), buffer.size_bytes());
    }
  }
  if (!leads()) return;
  PeerMesh::Interest interest;
  interest.awaited = {mesh_.right()};
  interest.bulk_queue_full = true;
  while (!send_due(operation, sizeof(T), buffer.size_bytes())) {
    while (const auto frame = mesh_.receive_control())
      throw RunError(worker_name(frame->from),
                     fmt::format("calls {} while this worker is still sending", name_of(frame->header.operation)));
    mesh_.wait(interest);
  }
  mesh_.finish_sends();
}

void HierarchicalSum::sum(Operation operation, std::span<float> buffer) { sum_chunks(operation, buffer); }
void HierarchicalSum::sum(Operation operation, std::span<double> buffer) { sum_chunks(operation, buffer); }

}  // namespace earshot
