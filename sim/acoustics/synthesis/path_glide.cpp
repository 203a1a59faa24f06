// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/synthesis/path_glide.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "sim/acoustics/synthesis/synthesis_tables.h"
#include "sim/audio/transforms/spectrum_math.h"
#include "sim/base/denormals.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr int kNoPartner = -1;

}  // namespace

PathGlider::PathGlider(std::shared_ptr<const SynthesisTables> tables, int block_samples, double most_slope)
    : filters_(tables),
      block_samples_(block_samples),
      max_paths_(tables->glide_paths),
      most_slope_(most_slope),
      num_channels_(static_cast<std::size_t>(filters_.num_channels())),
      num_taps_(static_cast<std::size_t>(filters_.num_taps())),
      fft_(4 * filters_.num_taps()),
      num_bins_(static_cast<std::size_t>(fft_.num_bins())),
      taps_(num_channels_ * num_taps_),
      piece_time_(static_cast<std::size_t>(fft_.size())) {
  require(block_samples >= 1, "samples of a block", block_samples, "must be at least 1");
  require(most_slope > 0 && most_slope <= kMaxSlope, "largest change of a delay", most_slope, "must be in (0, 0.25]");
  num_pieces_ = (static_cast<std::size_t>(block_samples) + hop() - 1) / hop();
  spectrum_.resize(num_pieces_ * num_bins_);
  sum_time_.resize(num_pieces_ * hop());
  for (Sum* sum : {&resting_, &from_, &to_, &entering_, &leaving_}) sum->spectrum.resize(num_channels_ * num_pieces_ * num_bins_);
  line_.reserve(static_cast<std::size_t>(block_samples) + num_taps_);
}

std::span<const std::uint8_t> PathGlider::choose(const EnergyResponse& response, const GlidingPaths* before) {
  const std::size_t count = response.arrivals.size();
  energy_.resize(count);
  float strongest = 0;
  for (std::size_t i = 0; i < count; ++i) {
    float sum = 0;
    for (const float amplitude : response.arrivals[i].amplitude) sum += amplitude * amplitude;
    energy_[i] = sum;
    strongest = std::max(strongest, sum);
  }
  const float weakest = strongest * static_cast<float>(std::pow(10.0, -0.1 * kRangeDb));
  mark_strongest(energy_, weakest, by_right_);
  if (before == nullptr) return marked_ = by_right_;
  const auto kept = static_cast<float>(std::pow(10.0, 0.1 * kKeptDb));
  const Pose& last = before->now_;
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint64_t identity = response.arrivals[i].identity;
    for (std::size_t path = 0; path < last.count && identity != 0; ++path)
      if (last.identity[path] == identity && last.by_right[path] != 0) energy_[i] *= kept;
  }
  mark_strongest(energy_, weakest, marked_);
  return marked_;
}

void PathGlider::mark_strongest(std::span<const float> energy, float weakest, std::vector<std::uint8_t>& marked) {
  marked.assign(energy.size(), 0);
  for (int n = 0; n < max_paths_; ++n) {
    std::size_t best = energy.size();
    for (std::size_t i = 0; i < energy.size(); ++i)
      if (marked[i] == 0 && energy[i] > 0 && (best == energy.size() || energy[i] > energy[best])) best = i;
    if (best == energy.size() || energy[best] < weakest) break;
    marked[best] = 1;
  }
}

void PathGlider::reserve(Pose& pose) const {
  const auto rows = static_cast<std::size_t>(max_paths_);
  if (pose.identity.size() == rows) return;
  pose.identity.resize(rows);
  pose.by_right.resize(rows);
  pose.partner.resize(rows);
  pose.delay.resize(rows * num_channels_);
  pose.slope.resize(rows * num_channels_);
  pose.filter.resize(rows * num_channels_ * num_bins_);
}

void PathGlider::advance(const EnergyResponse& response, std::span<const std::uint8_t> marked, const ListenerOrientation& orientation,
                         GlidingPaths& paths, int samples) {
  EARSHOT_EXPECT(samples >= 0 && samples <= block_samples_);
  EARSHOT_EXPECT(marked.size() == response.arrivals.size() && by_right_.size() == marked.size());
  const FlushDenormals flush;
  std::swap(paths.now_, paths.before_);
  Pose &now = paths.now_, &before = paths.before_;
  reserve(now);
  now.count = 0;
  paths.moves_ = std::exchange(paths.known_, true);
  paths.samples_ = samples > 0 ? samples : block_samples_;
  filters_.set_air(response.air);
  for (std::size_t i = 0; i < marked.size(); ++i) {
    if (marked[i] == 0) continue;
    const std::size_t path = now.count, row = path * num_channels_;
    const auto delay = std::span(now.delay).subspan(row, num_channels_), slope = std::span(now.slope).subspan(row, num_channels_);
    if (!filters_.make(response.arrivals[i], orientation, response.speed_of_sound_m_per_s, delay, taps_)) continue;
    for (std::size_t c = 0; c < num_channels_; ++c)
      fft_.forward(std::span(taps_).subspan(c * num_taps_, num_taps_), std::span(now.filter).subspan((row + c) * num_bins_, num_bins_));
    now.identity[path] = response.arrivals[i].identity;
    now.by_right[path] = by_right_[i];
    now.partner[path] = kNoPartner;
    std::ranges::fill(slope, 0.0);
    ++now.count;
    for (std::size_t other = 0; other < before.count && now.identity[path] != 0; ++other) {
      if (before.identity[other] != now.identity[path]) continue;
      double most = 0;
      for (std::size_t c = 0; c < num_channels_; ++c) {
        slope[c] = (delay[c] - before.delay[other * num_channels_ + c]) / paths.samples_;
        most = std::max(most, std::abs(slope[c]));
      }
      if (most < most_slope_)
        now.partner[path] = static_cast<int>(other);
      else
        std::ranges::fill(slope, 0.0);
      break;
    }
  }
}

/// line_[j]: the dry sound through the line at j - (num_taps / 2 - 1) samples from the start of the block.
void PathGlider::read_line(const DryBlock& dry, const Line& line) {
  const std::size_t half = num_taps_ / 2, before = half - 1;
  line_.resize(static_cast<std::size_t>(dry.samples) + num_taps_ - 1);
  const auto all = std::span(line_);
  dry.sound.read(dry.position, -static_cast<double>(before) * (1.0 - line.slope_before) - line.delay, 1.0 - line.slope_before,
                 all.first(before));
  dry.sound.read(dry.position, -line.delay, 1.0 - line.slope, all.subspan(before));
}

/// A line through a filter into one of the sums.
void PathGlider::add_line(const DryBlock& dry, const Line& line, const std::complex<float>* filter, std::size_t channel, Sum& sum) {
  read_line(dry, line);
  const auto whole = std::span<const float>(line_);
  for (std::size_t piece = 0; piece < pieces_; ++piece) {
    const auto from_piece = whole.subspan(piece * hop());
    fft_.forward(from_piece.first(std::min(from_piece.size(), static_cast<std::size_t>(fft_.size()))),
                 std::span(spectrum_).subspan(piece * num_bins_, num_bins_));
  }
  add_product(filter, channel, sum);
}

/// spectrum_ through a filter into one of the sums.
void PathGlider::add_product(const std::complex<float>* filter, std::size_t channel, Sum& sum) {
  if (!sum.any) std::ranges::fill(sum.spectrum, std::complex<float>{});
  sum.any = true;
  for (std::size_t piece = 0; piece < pieces_; ++piece) {
    multiply_add(std::span(spectrum_).subspan(piece * num_bins_, num_bins_), std::span(filter, num_bins_),
                 std::span(sum.spectrum).subspan((channel * num_pieces_ + piece) * num_bins_, num_bins_));
  }
}

void PathGlider::render(const OversampledSound& sound, const StreamPosition& position, int block, int fade, GlidingPaths& paths,
                        std::span<float> output) {
  const FlushDenormals flush;
  EARSHOT_EXPECT(block >= 0 && block <= block_samples_ && output.size() >= num_channels_ * static_cast<std::size_t>(block));
  const bool moves = std::exchange(paths.moves_, false);
  if (paths.now_.count + (moves ? paths.before_.count : 0) == 0 || block == 0) return;
  for (Sum* sum : {&resting_, &from_, &to_, &entering_, &leaving_}) sum->any = false;
  pieces_ = (static_cast<std::size_t>(block) + hop() - 1) / hop();
  const DryBlock dry{sound, position, block};
  add_present_paths(dry, paths, moves);
  if (moves) add_leaving_paths(dry, paths);
  fade_sums(block, fade, paths.samples_, output);
}

/// Paths of the new pose: at rest, entering, or gliding from the pose before.
void PathGlider::add_present_paths(const DryBlock& dry, GlidingPaths& paths, bool moves) {
  Pose& now = paths.now_;
  const Pose& before = paths.before_;
  for (std::size_t path = 0; path < now.count; ++path) {
    const int partner = moves ? now.partner[path] : kNoPartner;
    for (std::size_t c = 0; c < num_channels_; ++c) {
      const std::size_t row = path * num_channels_ + c;
      if (partner == kNoPartner) {
        // At rest what it did in the block before still rings in the filter.
        add_line(dry, {now.delay[row], 0.0, moves ? 0.0 : now.slope[row]}, filter_of(now, row), c, moves ? entering_ : resting_);
        now.slope[row] = 0;
      } else {
        const std::size_t old = static_cast<std::size_t>(partner) * num_channels_ + c;
        add_line(dry, {before.delay[old], now.slope[row], before.slope[old]}, filter_of(before, old), c, from_);
        add_product(filter_of(now, row), c, to_);
      }
    }
  }
}

/// Paths of the previous pose without a partner in the new one.
void PathGlider::add_leaving_paths(const DryBlock& dry, const GlidingPaths& paths) {
  const Pose& before = paths.before_;
  const auto partners = std::span(paths.now_.partner).first(paths.now_.count);
  for (std::size_t path = 0; path < before.count; ++path) {
    if (std::ranges::find(partners, static_cast<int>(path)) != partners.end()) continue;
    for (std::size_t c = 0; c < num_channels_; ++c) {
      const std::size_t row = path * num_channels_ + c;
      add_line(dry, {before.delay[row], 0.0, before.slope[row]}, filter_of(before, row), c, leaving_);
    }
  }
}

/// Fades are behind the filters: nothing is left of what leaves once the fade is over, and a block begins with what the one before ended.
void PathGlider::fade_sums(int block, int fade, int glided_samples, std::span<float> output) {
  const int faded = std::min(fade, block);
  const auto weight = [&](int i) { return static_cast<float>(i) / static_cast<float>(fade); };
  const float glide = 1.f / static_cast<float>(glided_samples);
  for (std::size_t c = 0; c < num_channels_; ++c) {
    float* out = output.data() + c * static_cast<std::size_t>(block);
    if (const float* heard = inverse(resting_, c))
      for (int i = 0; i < block; ++i) out[i] += heard[i];
    if (const float* heard = inverse(from_, c))
      for (int i = 0; i < block; ++i) out[i] += (1.f - glide * static_cast<float>(i)) * heard[i];
    if (const float* heard = inverse(to_, c))
      for (int i = 0; i < block; ++i) out[i] += glide * static_cast<float>(i) * heard[i];
    if (const float* heard = inverse(entering_, c)) {
      for (int i = 0; i < faded; ++i) out[i] += weight(i) * heard[i];
      for (int i = faded; i < block; ++i) out[i] += heard[i];
    }
    if (const float* heard = inverse(leaving_, c))
      for (int i = 0; i < faded; ++i) out[i] += (1.f - weight(i)) * heard[i];
  }
}

/// A sum in time from the start of the block on; null if there is none.
const float* PathGlider::inverse(const Sum& sum, std::size_t channel) {
  if (!sum.any) return nullptr;
  for (std::size_t piece = 0; piece < pieces_; ++piece) {
    fft_.inverse(std::span(sum.spectrum).subspan((channel * num_pieces_ + piece) * num_bins_, num_bins_), piece_time_);
    // Earlier samples hold the wrap-around (overlap-save).
    std::copy_n(piece_time_.begin() + static_cast<std::ptrdiff_t>(num_taps_) - 1, hop(),
                sum_time_.begin() + static_cast<std::ptrdiff_t>(piece * hop()));
  }
  return sum_time_.data();
}

}  // namespace earshot
