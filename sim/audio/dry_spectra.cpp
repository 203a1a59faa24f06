#include "sim/audio/dry_spectra.h"

#include <algorithm>

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
  const std::scoped_lock lock(set.mutex);
  Slot* oldest = nullptr;
  for (Slot& slot : set.slots) {
    if (slot.filled && slot.clip == clip && slot.start == start) {
      if (!slot.ready) return {State::busy};
      ++slot.readers;
      slot.last_used = ++set.clock;
      return {State::ready, index * kWays + static_cast<std::size_t>(&slot - set.slots)};
    }
    if (slot.readers == 0 && (oldest == nullptr || slot.last_used < oldest->last_used)) oldest = &slot;
  }
  if (oldest == nullptr) return {State::busy};
  *oldest = {.clip = clip, .start = start, .last_used = ++set.clock, .readers = 1, .filled = true, .ready = false};
  return {State::mine, index * kWays + static_cast<std::size_t>(oldest - set.slots)};
}

void DrySpectra::publish(std::size_t slot) {
  Set& set = sets_[slot / kWays];
  const std::scoped_lock lock(set.mutex);
  set.slots[slot % kWays].ready = true;
}

void DrySpectra::release(std::size_t slot) {
  Set& set = sets_[slot / kWays];
  const std::scoped_lock lock(set.mutex);
  --set.slots[slot % kWays].readers;
}

}  // namespace earshot
