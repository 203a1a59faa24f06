#include "sim/acoustics/synthesis/late_carriers.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "sim/base/random.h"

namespace earshot {
namespace {

/// Consumer of Purpose::carrier, apart from those of carriers.cpp, whose last counter word is 0.
constexpr std::uint32_t kPlaces = 2;

std::uint64_t mixed(std::uint64_t seed, std::uint64_t hash, std::uint32_t draw) {
  const auto bits =
      RandomStream(seed, Purpose::carrier, static_cast<std::uint32_t>(hash), static_cast<std::uint32_t>(hash >> 32), kPlaces).bits4(draw);
  return bits[0] | static_cast<std::uint64_t>(bits[1]) << 32;
}

}  // namespace

LateCarriers::LateCarriers(float sample_rate_hz, int num_samples, std::size_t loop_length, std::uint64_t seed)
    : loop_length_(loop_length), seed_(seed) {
  // Loops are a power of two: a whole number of pieces fits.
  const std::size_t piece = std::size_t{1} << static_cast<int>(std::lround(std::log2(kPieceS * static_cast<double>(sample_rate_hz))));
  piece_samples_ = static_cast<std::size_t>(num_samples) <= loop_length ? 0 : std::min(loop_length, piece);
}

/// Splits every cell where another one begins along one more axis.  position, border: in cells.  orders: whether the axis counts for order.
void LateCarriers::split_axis(float position, float border, std::uint32_t axis, bool orders) {
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
    const int even = orders ? 2 * cell.order : cell.order, odd = orders ? even + 1 : even;
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

void LateCarriers::set(const CarrierKey& key, std::uint32_t stream, const LateEnvelope& envelope) {
  const RandomStream random(seed_, Purpose::carrier, static_cast<std::uint32_t>(key.source), static_cast<std::uint32_t>(key.source >> 32),
                            kPlaces + 1);
  const auto shift = random.uniform4(2 * stream), other_shift = random.uniform4(2 * stream + 1);
  const std::uint64_t own = mixed(seed_, key.source, stream);
  start_ = own & (loop_length_ - 1);
  cells_.assign(1, {own, 0, 0.f, 1.f});
  for (int axis = 0; axis < 3; ++axis) {
    const float cell_m = axis == 1 ? kCellHeightM : kCellM, border = kBorderM / cell_m;
    const auto draw = static_cast<std::uint32_t>(axis);
    if (key.listener) split_axis((*key.listener)[axis] / cell_m + shift[draw], border, 16 + draw, true);
    if (key.moving_source) split_axis((*key.moving_source)[axis] / cell_m + other_shift[draw], border, 32 + draw, false);
  }
  cells_.back().end = 2.f;  // whatever rounding leaves

  envelope.energy_before(before_);
  const auto num_bins = static_cast<std::size_t>(envelope.size());
  first_cell_.resize(num_bins);
  piece_.resize(num_bins);
  std::size_t cell = 0;
  for (std::size_t bin = 0; bin < num_bins; ++bin) {
    while (cells_[cell].end <= before_[bin]) ++cell;
    first_cell_[bin] = cell;
    piece_[bin] = piece_samples_ == 0 ? 0 : static_cast<std::size_t>(envelope.middle_sample(static_cast<int>(bin))) / piece_samples_;
  }
}

/// Pieces of one round lie at multiples of their length from a start of the cell's own, in the order of a full cycle (Hull and Dobell 1962:
/// an odd step, modulo a power of two); each round begins elsewhere.
std::size_t LateCarriers::place(const Cell& cell, std::size_t piece, std::size_t sample) const {
  if (piece_samples_ == 0) {
    // Eight orders, that of the cell that sounds earlier the lower, in half the loop: what a later cell repeats comes half a loop later at
    // the earliest.  A tenth of each stays free, so that two of them never begin together.
    const double part = static_cast<double>(loop_length_) / 16.0, within = 0.9 * static_cast<double>(cell.hash >> 40) / 16777216.0;
    return (start_ + static_cast<std::size_t>(part * (cell.order + within)) + sample) & (loop_length_ - 1);
  }
  const std::size_t per_round = loop_length_ / piece_samples_;
  const std::uint64_t bits = mixed(seed_, cell.hash, 64 + static_cast<std::uint32_t>(piece / per_round));
  const std::size_t step = 2 * (bits % per_round) + 1, start = (bits >> 32) % loop_length_;
  const std::size_t since = sample - piece * piece_samples_;  // wraps below zero where the piece fades in: modulo 2^64
  return (start + piece * step % per_round * piece_samples_ + since) & (loop_length_ - 1);
}

void LateCarriers::add(const LateSegment& segment, std::size_t cell, std::size_t piece, float left, float right) {
  if (left == 0.f && right == 0.f) return;
  reads_.push_back({place(cells_[cell], piece, segment.begin), left, right});
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
    if (piece_[left] == piece_[right]) {
      add(segment, cell, piece_[left], at_left, at_right);
    } else {
      add(segment, cell, piece_[left], at_left, 0.f);
      add(segment, cell, piece_[right], 0.f, at_right);
    }
    if (cells_[cell].end >= before_[right + 1]) break;
  }
  return reads_;
}

}  // namespace earshot
