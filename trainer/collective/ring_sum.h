// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <span>

#include "sim/base/errors.h"
#include "trainer/collective/collective.h"
#include "trainer/collective/sum_order.h"
#include "trainer/net/peer_links.h"
#include "trainer/net/wire.h"

namespace earshot {

/// The error of a peer that makes another call than this worker.
inline RunError call_mismatch(int rank, const FrameHeader& got, Operation operation, std::size_t total) {
  return {worker_name(rank),
          fmt::format("calls {} with {} bytes, but this worker calls {} with {} bytes; start all workers with the same program and config",
                      name_of(got.operation), got.total, name_of(operation), total)};
}

/// buffer += message, element by element.  The message may lie at any address.
template <class T>
void add_to(std::span<T> buffer, std::span<const std::byte> message) {
  for (std::size_t i = 0; i < buffer.size(); ++i) {
    T value;
    std::memcpy(&value, message.data() + i * sizeof(T), sizeof(T));
    buffer[i] += value;
  }
}

/// Where the ring cuts a buffer.  Step s of 2 (P - 1): send segment (rank - s), receive segment (rank - s - 1), both mod P.
class RingSchedule {
 public:
  RingSchedule(std::size_t count, std::size_t element_bytes, WorkerIdentity identity)
      : count_(count), element_bytes_(element_bytes), rank_(identity.rank), world_size_(identity.world_size) {}

  struct Chunk {
    std::uint32_t step = 0, segment = 0;
    std::size_t first = 0, count = 0;  ///< elements
  };
  [[nodiscard]] std::uint32_t num_steps() const { return static_cast<std::uint32_t>(2 * (world_size_ - 1)); }
  [[nodiscard]] bool reducing(std::uint32_t step) const { return step < static_cast<std::uint32_t>(world_size_ - 1); }
  [[nodiscard]] std::uint32_t sent_segment(std::uint32_t step) const { return modulo(rank_ - static_cast<int>(step)); }
  [[nodiscard]] std::uint32_t received_segment(std::uint32_t step) const { return modulo(rank_ - static_cast<int>(step) - 1); }
  [[nodiscard]] std::size_t num_chunks(std::uint32_t segment) const {
    const std::size_t size = start(segment + 1) - start(segment);
    return (size + chunk_count() - 1) / chunk_count();
  }
  [[nodiscard]] Chunk chunk(std::uint32_t step, std::uint32_t segment, std::size_t index) const {
    const std::size_t first = start(segment) + index * chunk_count();
    return {step, segment, first, std::min(chunk_count(), start(segment + 1) - first)};
  }

 private:
  [[nodiscard]] std::uint32_t modulo(int value) const {
    return static_cast<std::uint32_t>(((value % world_size_) + world_size_) % world_size_);
  }
  [[nodiscard]] std::size_t chunk_count() const { return kChunkBytes / element_bytes_; }
  [[nodiscard]] std::size_t start(std::uint32_t segment) const {
    return segment_start(count_, segment, static_cast<std::size_t>(world_size_));
  }

  std::size_t count_, element_bytes_;
  int rank_, world_size_;
};

/// A position in the order of all chunks of one direction.
struct Cursor {
  std::uint32_t step = 0;
  std::size_t chunk = 0;
  void advance(std::size_t chunks_in_step) {
    if (++chunk < chunks_in_step) return;
    chunk = 0;
    ++step;
  }
};

/// Large sums go round the ring: reduce-scatter, then all-gather (Patarasuk and Yuan 2009), in the order of sum_order.h.  Mesh: a PeerMesh
/// or another that has bulk messages to a right neighbour.
template <class Mesh, class T>
void sum_round_ring(Mesh& mesh, Operation operation, std::span<T> buffer) {
  const RingSchedule schedule(buffer.size(), sizeof(T), mesh.identity());
  Cursor sent, received;
  PeerInterest interest;
  interest.awaited = {mesh.left()};
  while (true) {
    // Send what is ready: the first segment at once, then each chunk as soon as it has come in and been summed one step before.  A chunk
    // that libzmq still reads is never written: its sum comes back only after the right neighbour has read our part.
    interest.bulk_queue_full = false;
    while (sent.step < schedule.num_steps() &&
           (sent.step == 0 || received.step >= sent.step || (received.step + 1 == sent.step && received.chunk > sent.chunk))) {
      const auto chunk = schedule.chunk(sent.step, schedule.sent_segment(sent.step), sent.chunk);
      FrameHeader header;
      header.operation = operation;
      header.phase = schedule.reducing(chunk.step) ? 0 : 1;
      header.step = chunk.step;
      header.segment = chunk.segment;
      header.offset = chunk.first * sizeof(T);
      header.total = buffer.size_bytes();
      if (!mesh.send_bulk(header, std::as_bytes(buffer.subspan(chunk.first, chunk.count)))) {
        interest.bulk_queue_full = true;
        break;
      }
      sent.advance(schedule.num_chunks(chunk.segment));
    }
    bool progress = false;
    if (received.step < schedule.num_steps()) {
      if (const auto frame = mesh.receive_bulk()) {
        const auto chunk = schedule.chunk(received.step, schedule.received_segment(received.step), received.chunk);
        const FrameHeader& header = frame->header;
        if (header.operation != operation || header.total != buffer.size_bytes())
          throw call_mismatch(mesh.rank_of(frame->from), header, operation, buffer.size_bytes());
        if (header.step != chunk.step || header.segment != chunk.segment || header.phase != (schedule.reducing(chunk.step) ? 0 : 1) ||
            header.offset != chunk.first * sizeof(T) || header.length != chunk.count * sizeof(T))
          throw RunError(worker_name(mesh.rank_of(frame->from)), "sends the wrong part of the buffer");
        const std::span<T> target = buffer.subspan(chunk.first, chunk.count);
        if (schedule.reducing(chunk.step))
          add_to(target, frame->bytes());
        else
          std::memcpy(target.data(), frame->payload.data(), target.size_bytes());
        received.advance(schedule.num_chunks(chunk.segment));
        progress = true;
      }
    }
    if (progress) continue;
    while (const auto frame = mesh.receive_control())
      throw call_mismatch(mesh.rank_of(frame->from), frame->header, operation, buffer.size_bytes());
    interest.bulk_data = received.step < schedule.num_steps();
    if (!interest.bulk_data && sent.step == schedule.num_steps()) break;
    mesh.wait(interest);
  }
  mesh.finish_sends();
}

}  // namespace earshot
