// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/synthesis/binaural_late_tail.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace earshot {
namespace {

/// Contribution of one band to one segment.
struct EarBand {
  Ramp left, shared, own;
  const float *part0, *part1;
};

// Without __restrict on the outputs the loops are not vectorized.
void add_band(int count, const EarBand& band, float* __restrict left, float* __restrict right) {
  for (int i = 0; i < count; ++i) {
    left[i] += band.left.at(i) * band.part0[i];
    right[i] += band.shared.at(i) * band.part0[i] + band.own.at(i) * band.part1[i];
  }
}

/// Two bands at a time: the outputs are read and written half as often.
void add_bands(int count, const EarBand& a, const EarBand& b, float* __restrict left, float* __restrict right) {
  const EarBand p = a, q = b;
  for (int i = 0; i < count; ++i) {
    left[i] = (left[i] + p.left.at(i) * p.part0[i]) + q.left.at(i) * q.part0[i];
    right[i] =
        (right[i] + (p.shared.at(i) * p.part0[i] + p.own.at(i) * p.part1[i])) + (q.shared.at(i) * q.part0[i] + q.own.at(i) * q.part1[i]);
  }
}

/// A part of the power, which changes linearly.
void add_part(int count, Ramp power, const EarBand& band, float* __restrict left, float* __restrict right) {
  for (int i = 0; i < count; ++i) {
    const float s = std::sqrt(std::max(power.at(i), 0.f)), common = s * band.part0[i];
    left[i] += band.left.at(i) * common;
    right[i] += band.shared.at(i) * common + band.own.at(i) * (s * band.part1[i]);
  }
}

/// From silence or to it: linearly in power.
void add_fading(int count, Ramp power, const BinauralNoise::Mix& mix, const float* part0, const float* part1, float* __restrict left,
                float* __restrict right) {
  for (int i = 0; i < count; ++i) {
    const float s = std::sqrt(std::max(power.at(i), 0.f)), common = s * part0[i];
    left[i] += mix.left * common;
    right[i] += mix.shared * common + mix.own * (s * part1[i]);
  }
}

}  // namespace

void BinauralLateTail::make_mixes(const LateEnvelope& envelope, int first_bin, const BinauralNoise& noise,
                                  const ListenerOrientation& orientation) {
  rotation_.set(orientation);
  std::array<std::array<float, 3>, 3> to_head{};
  for (int m = 0; m < 3; ++m)
    for (int n = 0; n < 3; ++n)
      to_head[static_cast<std::size_t>(m)][static_cast<std::size_t>(n)] = static_cast<float>(rotation_.at(1, m - 1, n - 1));
  const auto num_bins = static_cast<std::size_t>(envelope.size());
  mixes_.resize(static_cast<std::size_t>(envelope.num_bands()) * num_bins);
  for (int band = 0; band < envelope.num_bands(); ++band) {
    const auto row = envelope.band(band);
    for (auto bin = static_cast<std::size_t>(first_bin); bin < num_bins; ++bin) {
      if (!(row[bin].density > 0.f)) continue;
      const auto& world = row[bin].m;
      std::array<float, 3> m;
      for (std::size_t i = 0; i < 3; ++i) m[i] = to_head[i][0] * world[0] + to_head[i][1] * world[1] + to_head[i][2] * world[2];
      BinauralNoise::Mix& mix = mixes_[static_cast<std::size_t>(band) * num_bins + bin] = noise.mix(band, m);
      const float amplitude = std::sqrt(row[bin].density);
      mix.left *= amplitude, mix.shared *= amplitude, mix.own *= amplitude;
    }
  }
}

void BinauralLateTail::add(const LateEnvelope& envelope, int first_bin, const BinauralNoise& noise, LateCarriers& place,
                           const ListenerOrientation& orientation, std::span<float> left, std::span<float> right) {
  if (first_bin >= envelope.size()) return;
  make_mixes(envelope, first_bin, noise, orientation);
  const auto num_bins = static_cast<std::size_t>(envelope.size());
  const auto add_read = [&](const LateSegment& segment, const LateCarriers::Read& read) {
    EarBand waiting{};  // for another band to be added with
    bool waits = false;
    float *out_left = left.data() + segment.begin, *out_right = right.data() + segment.begin;
    for (int band = 0; band < envelope.num_bands(); ++band) {
      const auto row = envelope.band(band);
      const BinauralNoise::Mix* mixes = mixes_.data() + static_cast<std::size_t>(band) * num_bins;
      const float *part0 = noise.loop(band, 0, read.kind).data() + read.in_loop,
                  *part1 = noise.loop(band, 1, read.kind).data() + read.in_loop;
      const bool from_sound = segment.left >= first_bin && row[static_cast<std::size_t>(segment.left)].density > 0.f;
      const bool to_sound = row[static_cast<std::size_t>(segment.right)].density > 0.f;
      if (!from_sound && !to_sound) continue;
      if (from_sound != to_sound) {
        add_fading(segment.count, ramp_over(segment, from_sound ? read.left : 0.f, to_sound ? read.right : 0.f),
                   mixes[from_sound ? segment.left : segment.right], part0, part1, out_left, out_right);
        continue;
      }
      const BinauralNoise::Mix &a = mixes[segment.left], &b = mixes[segment.right];
      const EarBand now{ramp_over(segment, a.left, b.left), ramp_over(segment, a.shared, b.shared), ramp_over(segment, a.own, b.own), part0,
                        part1};
      if (!read.whole()) {
        add_part(segment.count, ramp_over(segment, read.left, read.right), now, out_left, out_right);
        continue;
      }
      if (waits)
        add_bands(segment.count, waiting, now, out_left, out_right);
      else
        waiting = now;
      waits = !waits;
    }
    if (waits) add_band(segment.count, waiting, out_left, out_right);
  };
  envelope.visit(CarrierBank::kPad, [&](const LateSegment& segment) {
    if (segment.right < first_bin) return;
    for (const LateCarriers::Read& read : place.reads(segment)) add_read(segment, read);
  });
}

}  // namespace earshot
