// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/synthesis/late_carriers.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "sim/base/random.h"

namespace earshot {
namespace {

/// Consumer of Purpose::carrier, apart from those of carriers.cpp, whose last counter word is 0.
constexpr std::uint32_t kPlaces = 2;
/// Bits of the kind of noise by which the odd cells along each axis differ from the even ones: two axes together have all four kinds.
constexpr std::array<std::uint32_t, 3> kParity = {1, 3, 2};

std::uint64_t mixed(std::uint64_t seed, std::uint64_t hash, std::uint32_t draw) {
  const auto bits =
      RandomStream(seed, Purpose::carrier, static_cast<std::uint32_t>(hash), static_cast<std::uint32_t>(hash >> 32), kPlaces).bits4(draw);
  return bits[0] | static_cast<std::uint64_t>(bits[1]) << 32;
}

}  // namespace

LateCarriers::LateCarriers(int num_samples, const CarrierBank& bank, std::uint64_t seed)
    : num_kinds_(bank.num_kinds()), loop_length_(bank.length()), apart_(loop_length_ / 16), seed_(seed) {
  round_samples_ = static_cast<std::size_t>(num_samples) + apart_ <= loop_length_ ? 0 : loop_length_ - apart_;
}

/// Splits every cell where another one begins along one more axis.  position, border: in cells.  parity: by which odd cells differ in
/// noise.
void LateCarriers::split_axis(float position, float border, std::uint32_t axis, std::uint32_t parity) {
  const double index = std::floor(static_cast<double>(position));
  const auto from = static_cast<float>(static_cast<double>(position) - index);
  const float half = 0.5f * border;
  // The lower of the one or two cells, and the weight of the one above it.
  const double lower = from < half ? index - 1 : index;
  const float upper = from < half ? 0.5f + 0.5f * from / half : from > 1.f - half ? 0.5f - 0.5f * (1.f - from) / half : 0.f;
  const auto child = [&](const Cell& cell, double at) {
    // Exact for all whole numbers that a float can be near.
    return mixed(seed_, cell.hash ^ static_cast<std::uint64_t>(static_cast<std::int64_t>(at)), axis);
  };
  // Even cells come first: from there on to the next but one, the parts of both keep their ends.
  const bool odd_lower = std::fmod(std::abs(lower), 2.0) == 1.0;
  split_.clear();
  for (const Cell& cell : cells_) {
    const float length = cell.end - cell.begin;
    const std::uint32_t even = cell.kind, odd = cell.kind ^ parity;
    if (upper == 0.f) {
      split_.push_back({child(cell, lower), odd_lower ? odd : even, cell.begin, cell.end});
      continue;
    }
    const double first = odd_lower ? lower + 1 : lower, second = odd_lower ? lower : lower + 1;
    const float middle = cell.begin + (odd_lower ? upper : 1.f - upper) * length;
    split_.push_back({child(cell, first), even, cell.begin, middle});
    split_.push_back({child(cell, second), odd, middle, cell.end});
  }
  std::swap(cells_, split_);
}

void LateCarriers::set(const CarrierKey& key, std::uint32_t stream, const LateEnvelope& envelope, std::size_t ahead) {
  const RandomStream random(seed_, Purpose::carrier, static_cast<std::uint32_t>(key.source), static_cast<std::uint32_t>(key.source >> 32),
                            kPlaces + 1);
  const auto shift = random.uniform4(2 * stream), other_shift = random.uniform4(2 * stream + 1);
  const std::uint64_t stream_seed = mixed(seed_, key.source, stream);
  ahead_ = ahead;
  cells_.assign(1, {stream_seed, static_cast<std::uint32_t>(stream_seed) & 3u, 0.f, 1.f});
  for (int axis = 0; axis < 3; ++axis) {
    const float cell_m = axis == 1 ? kCellHeightM : kCellM, border = kBorderM / cell_m;
    const auto draw = static_cast<std::uint32_t>(axis);
    // A face of the listener's cells and one of the source's along the same axis have four kinds.
    if (key.listener) split_axis((*key.listener)[axis] / cell_m + shift[draw], border, 16 + draw, kParity[draw]);
    if (key.moving_source) split_axis((*key.moving_source)[axis] / cell_m + other_shift[draw], border, 32 + draw, kParity[(draw + 1) % 3]);
  }
  cells_.back().end = 2.f;  // whatever rounding leaves

  envelope.energy_before(before_);
  const auto num_bins = static_cast<std::size_t>(envelope.size());
  first_cell_.resize(num_bins);
  round_.resize(num_bins);
  std::size_t cell = 0;
  for (std::size_t bin = 0; bin < num_bins; ++bin) {
    while (cells_[cell].end <= before_[bin]) ++cell;
    first_cell_[bin] = cell;
    round_[bin] = round_samples_ == 0 ? 0 : static_cast<std::size_t>(envelope.middle_sample(static_cast<int>(bin))) / round_samples_;
  }
}

/// A round is as much as a loop holds; each has the next kind of noise.
LateCarriers::Read LateCarriers::place(const Cell& cell, std::size_t round, std::size_t sample) const {
  const auto kind = static_cast<int>((cell.kind + static_cast<std::uint32_t>(round)) % static_cast<std::uint32_t>(num_kinds_));
  const std::uint64_t start = mixed(seed_, cell.hash, 64 + static_cast<std::uint32_t>(round));
  const std::size_t since = sample - round * round_samples_;  // wraps below zero where a round fades in: modulo 2^64
  return {kind, (start + since + ahead_) & (loop_length_ - 1), 0.f, 0.f};
}

void LateCarriers::add(const LateSegment& segment, std::size_t cell, std::size_t round, float left, float right) {
  if (left == 0.f && right == 0.f) return;
  Read& read = reads_.emplace_back(place(cells_[cell], round, segment.begin));
  read.left = left, read.right = right;
}

std::span<const LateCarriers::Read> LateCarriers::reads(const LateSegment& segment) {
  reads_.clear();
  const auto left = static_cast<std::size_t>(segment.left), right = static_cast<std::size_t>(segment.right);
  // Fraction of a bin's energy that lies in the cell's part.
  const auto fraction = [&](std::size_t bin, std::size_t cell) {
    if (cell < first_cell_[bin]) return 0.f;
    const float begin = before_[bin], end = before_[bin + 1];
    const float from = std::max(begin, cells_[cell].begin), to = std::min(end, cells_[cell].end);
    if (cell == first_cell_[bin] && end <= cells_[cell].end) return 1.f;
    return to > from ? (to - from) / (end - begin) : 0.f;
  };
  for (std::size_t cell = first_cell_[left]; cell < cells_.size(); ++cell) {
    const float at_left = fraction(left, cell), at_right = fraction(right, cell);
    if (round_[left] == round_[right]) {
      add(segment, cell, round_[left], at_left, at_right);
    } else {
      add(segment, cell, round_[left], at_left, 0.f);
      add(segment, cell, round_[right], 0.f, at_right);
    }
    if (cells_[cell].end >= before_[right + 1]) break;
  }
  return reads_;
}

}  // namespace earshot
