#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace earshot {

/// Time axis of a source field: the bins of the histogram one by one while single reflections stand out, later in fours.  Late energy
/// changes by the decay alone, which is known from bin to bin once it is known from four to four: a third of the memory and of all that
/// goes through it.  Slots: 0 to fine() - 1 hold one bin each, the others kWide, the last one what is left.
class FieldBins {
 public:
  static constexpr std::size_t kWide = 4;
  static constexpr double kFineS = 0.1;

  FieldBins(int num_bins, float bin_s)
      : bins_(static_cast<std::size_t>(num_bins)),
        fine_(std::min(bins_, static_cast<std::size_t>(std::ceil(kFineS / double{bin_s} * (1 - 1e-6))))),
        slots_(fine_ + (bins_ - fine_ + kWide - 1) / kWide) {}

  [[nodiscard]] std::size_t fine() const { return fine_; }
  [[nodiscard]] std::size_t size() const { return slots_; }
  [[nodiscard]] std::size_t slot_of(std::size_t bin) const { return bin < fine_ ? bin : fine_ + (bin - fine_) / kWide; }
  /// First bin of a slot; of slot size(): the number of bins.
  [[nodiscard]] std::size_t first_bin(std::size_t slot) const {
    return slot < fine_ ? slot : std::min(bins_, fine_ + (slot - fine_) * kWide);
  }
  [[nodiscard]] std::size_t width(std::size_t slot) const { return first_bin(slot + 1) - first_bin(slot); }
  /// Middle of a slot, in bins.
  [[nodiscard]] double middle(std::size_t slot) const {
    return 0.5 * (static_cast<double>(first_bin(slot)) + static_cast<double>(first_bin(slot + 1)));
  }

 private:
  std::size_t bins_, fine_, slots_;
};

}  // namespace earshot
