// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/dry_sounds/dry_spectra.h"

#include "sim/base/errors.h"

namespace earshot {

DrySpectra::DrySpectra(int fft_size, std::size_t max_bytes) {
  require(fft_size >= 16, "fft size", fft_size, "must be at least 16");
  size_ = static_cast<std::size_t>(fft_size);
  num_sets_ = std::max<std::size_t>(1, max_bytes / (kWays * size_ * sizeof(std::complex<float>)));
  sets_ = std::make_unique<Set[]>(num_sets_);
  const std::size_t count = num_sets_ * kWays * size_;
  values_ = {VectorAllocator<std::complex<float>>().allocate(count), Free{count}};
}

DrySpectra::Place DrySpectra::find(std::uint64_t clip, std::uint64_t start) {
  std::uint64_t mixed = (clip ^ (start * 0x9E3779B97F4A7C15u)) * 0xD6E8FEB86659FD93u;
  mixed ^= mixed >> 32;
  const std::size_t index = static_cast<std::size_t>(mixed % num_sets_);
  Set& set = sets_[index];
  if (set.taken.exchange(true, std::memory_order_acquire)) return {State::busy};
  const Place place = find_in(set, clip, start);
  set.taken.store(false, std::memory_order_release);
  return place.state == State::busy ? place : Place{place.state, index * kWays + place.slot};
}

DrySpectra::Place DrySpectra::find_in(Set& set, std::uint64_t clip, std::uint64_t start) {
  std::size_t oldest = kWays;
  for (std::size_t i = 0; i < kWays; ++i) {
    Slot& slot = set.slots[i];
    if (slot.filled && slot.clip == clip && slot.start == start) {
      if (!slot.ready.load(std::memory_order_acquire)) return {State::busy};
      slot.readers.fetch_add(1, std::memory_order_relaxed);
      slot.last_used = ++set.clock;
      return {State::ready, i};
    }
    // Acquired, so that what its last reader has read is read before it is written anew.
    if (slot.readers.load(std::memory_order_acquire) == 0 && (oldest == kWays || slot.last_used < set.slots[oldest].last_used)) oldest = i;
  }
  if (oldest == kWays) return {State::busy};
  Slot& slot = set.slots[oldest];
  slot.clip = clip;
  slot.start = start;
  slot.last_used = ++set.clock;
  slot.filled = true;
  slot.ready.store(false, std::memory_order_relaxed);
  slot.readers.store(1, std::memory_order_relaxed);
  return {State::mine, oldest};
}

void DrySpectra::publish(std::size_t slot) { sets_[slot / kWays].slots[slot % kWays].ready.store(true, std::memory_order_release); }

void DrySpectra::release(std::size_t slot) { sets_[slot / kWays].slots[slot % kWays].readers.fetch_sub(1, std::memory_order_release); }

}  // namespace earshot
