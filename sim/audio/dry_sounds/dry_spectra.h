// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <complex>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "sim/audio/transforms/complex_fft.h"

namespace earshot {

/// A set-associative cache of spectra of segments of dry sounds, shared by all convolvers of a plan: agents with the same looping clip
/// transform the same segments again and again.  Bounded: the least recently used of the eight slots of a set is replaced.  Thread-safe,
/// without locks: a thread that finds a set in use by another works its spectrum out itself.  A spectrum is a pure function of its key: a
/// hit and a miss give the same bits.
class DrySpectra {
 public:
  /// Takes max_bytes of address space at once, memory as it fills.
  DrySpectra(int fft_size, std::size_t max_bytes);
  [[nodiscard]] int fft_size() const { return static_cast<int>(size_); }

  /// A spectrum that is not replaced for the lifetime of this object.
  class View {
   public:
    explicit View(std::span<const std::complex<float>> spectrum) : spectrum_(spectrum) {}
    View(DrySpectra& owner, std::size_t slot) : spectrum_(owner.spectrum(slot)), owner_(&owner), slot_(slot) {}
    View(const View&) = delete;
    View& operator=(const View&) = delete;
    ~View() {
      if (owner_ != nullptr) owner_->release(slot_);
    }
    [[nodiscard]] std::span<const std::complex<float>> spectrum() const { return spectrum_; }

   private:
    std::span<const std::complex<float>> spectrum_;
    DrySpectra* owner_ = nullptr;
    std::size_t slot_ = 0;
  };

  /// The spectrum of the segment at `start` of the clip with hash `clip`; make(out) writes it [fft_size] on a miss, to `scratch` if its set
  /// or all slots of it are in use by other threads.
  template <class Make>
  View get(std::uint64_t clip, std::uint64_t start, std::span<std::complex<float>> scratch, Make&& make) {
    const Place place = find(clip, start);
    if (place.state == State::ready) return View(*this, place.slot);
    if (place.state == State::busy) {
      make(scratch);
      return View(scratch);
    }
    make(spectrum(place.slot));
    publish(place.slot);
    return View(*this, place.slot);
  }

 private:
  static constexpr std::size_t kWays = 8;
  enum class State { ready, mine, busy };
  struct Place {
    State state;
    std::size_t slot = 0;
  };
  struct Slot {
    std::uint64_t clip = 0, start = 0, last_used = 0;  // these and `filled` belong to the thread that has taken the set
    bool filled = false;
    std::atomic<bool> ready{false};  // set by the thread that has filled it
    std::atomic<int> readers{0};     // raised by the thread that has taken the set, lowered by any
  };
  struct Set {
    std::atomic<bool> taken{false};
    std::uint64_t clock = 0;
    Slot slots[kWays];
  };

  Place find(std::uint64_t clip, std::uint64_t start);
  /// Of a set that this thread has taken; the slot counts within it.
  static Place find_in(Set& set, std::uint64_t clip, std::uint64_t start);
  void publish(std::size_t slot);
  void release(std::size_t slot);
  [[nodiscard]] std::span<std::complex<float>> spectrum(std::size_t slot) { return {values_.get() + slot * size_, size_}; }
  struct Free {
    std::size_t count;
    void operator()(std::complex<float>* memory) const { VectorAllocator<std::complex<float>>().deallocate(memory, count); }
  };

  std::size_t size_ = 0, num_sets_ = 0;
  std::unique_ptr<Set[]> sets_;
  std::unique_ptr<std::complex<float>[], Free> values_;  ///< [slot][size]
};

}  // namespace earshot
