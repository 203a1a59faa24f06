// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/synthesis/late_synthesis.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "sim/base/errors.h"

namespace earshot {
namespace {

void add_omni(int count, Ramp density, const float* w, float* out) {
  for (int i = 0; i < count; ++i) out[i] += std::sqrt(std::max(density.at(i), 0.f)) * w[i];
}

/// Amplitudes of the four channels at one segment.
struct FirstOrderRamps {
  Ramp density, m1, m2, m3, d;
};

/// Contribution of one band to one segment.
struct FirstOrderBand {
  FirstOrderRamps ramps;
  std::array<const float*, 4> carrier;
};

// Without __restrict on the outputs the loop is not vectorized (3 times the time).
void add_first_order(int count, const FirstOrderBand& band, float* __restrict out0, float* __restrict out1, float* __restrict out2,
                     float* __restrict out3) {
  const FirstOrderRamps ramps = band.ramps;
  const float *w = band.carrier[0], *n1 = band.carrier[1], *n2 = band.carrier[2], *n3 = band.carrier[3];
  for (int i = 0; i < count; ++i) {
    const float s = std::sqrt(std::max(ramps.density.at(i), 0.f));
    const float omni = s * w[i], diffuse = s * ramps.d.at(i);
    out0[i] += omni;
    out1[i] += ramps.m1.at(i) * omni + diffuse * n1[i];
    out2[i] += ramps.m2.at(i) * omni + diffuse * n2[i];
    out3[i] += ramps.m3.at(i) * omni + diffuse * n3[i];
  }
}

using FirstOrderPair = std::array<FirstOrderBand, 2>;

/// Two bands at a time: the outputs are read and written half as often.
void add_first_order(int count, const FirstOrderPair& bands, float* __restrict out0, float* __restrict out1, float* __restrict out2,
                     float* __restrict out3) {
  const auto& [a, b] = bands;
  const FirstOrderRamps p = a.ramps, q = b.ramps;
  const float *w = a.carrier[0], *n1 = a.carrier[1], *n2 = a.carrier[2], *n3 = a.carrier[3];
  const float *v = b.carrier[0], *k1 = b.carrier[1], *k2 = b.carrier[2], *k3 = b.carrier[3];
  for (int i = 0; i < count; ++i) {
    const float s = std::sqrt(std::max(p.density.at(i), 0.f)), t = std::sqrt(std::max(q.density.at(i), 0.f));
    const float omni = s * w[i], diffuse = s * p.d.at(i), other_omni = t * v[i], other_diffuse = t * q.d.at(i);
    out0[i] = (out0[i] + omni) + other_omni;
    out1[i] = (out1[i] + (p.m1.at(i) * omni + diffuse * n1[i])) + (q.m1.at(i) * other_omni + other_diffuse * k1[i]);
    out2[i] = (out2[i] + (p.m2.at(i) * omni + diffuse * n2[i])) + (q.m2.at(i) * other_omni + other_diffuse * k2[i]);
    out3[i] = (out3[i] + (p.m3.at(i) * omni + diffuse * n3[i])) + (q.m3.at(i) * other_omni + other_diffuse * k3[i]);
  }
}

/// Amplitudes of one channel above first order at one segment.
struct HigherRamps {
  Ramp density, m, d;
};

void add_higher(int count, HigherRamps ramps, const float* w, const float* n, float* __restrict out) {
  for (int i = 0; i < count; ++i) out[i] += std::sqrt(std::max(ramps.density.at(i), 0.f)) * (ramps.m.at(i) * w[i] + ramps.d.at(i) * n[i]);
}

}  // namespace

void LateSynthesizer::make_higher(const LateEnvelope& envelope, int num_bins, std::size_t num_channels) {
  const std::size_t higher = num_channels - 4;
  higher_.assign(static_cast<std::size_t>(envelope.num_bands() * envelope.size()) * higher, HigherAmplitude{});
  for (int band = 0; band < envelope.num_bands(); ++band) {
    for (int bin = 0; bin < num_bins; ++bin) {
      const auto known = envelope.higher(band, bin);
      HigherAmplitude* amplitudes = higher_.data() + static_cast<std::size_t>(band * envelope.size() + bin) * higher;
      for (std::size_t l = 2; (l + 1) * (l + 1) <= std::min(num_channels, known.size() + 4); ++l) {
        const std::size_t first = l * l - 4, count = 2 * l + 1;
        double square = 0;
        for (std::size_t j = first; j < first + count; ++j) square += static_cast<double>(known[j]) * static_cast<double>(known[j]);
        const double whole = static_cast<double>(count);
        const double limit = square > whole ? std::sqrt(whole / square) : 1.0;
        const auto d = static_cast<float>(std::sqrt(std::max(0.0, 1.0 - square / whole)));
        for (std::size_t j = first; j < first + count; ++j) amplitudes[j] = {static_cast<float>(limit * static_cast<double>(known[j])), d};
      }
    }
  }
}

std::size_t LateSynthesizer::render(const LateEnvelope& envelope, int num_bins, const CarrierBank& carriers, LateCarriers& place,
                                    std::span<const std::span<float>> channels) {
  const auto num_channels = channels.size();
  EARSHOT_EXPECT(num_channels <= static_cast<std::size_t>(carriers.num_channels()) && (num_channels == 1 || num_channels >= 4));
  const std::size_t end = envelope.end_before(num_bins);
  for (const auto& channel : channels) std::ranges::fill(channel.first(end), 0.f);
  const int num_bands = envelope.num_bands();
  if (num_channels > 4) make_higher(envelope, num_bins, num_channels);

  std::size_t end_of_sound = 0;
  const auto add = [&](const LateSegment& segment, const LateCarriers::Read& read) {
    const auto out = [&](std::size_t c) { return channels[c].data() + segment.begin; };
    FirstOrderPair bands{};
    bool waits = false;  // bands[0] holds a band that is not yet added
    for (int band = 0; band < num_bands; ++band) {
      const auto row = envelope.band(band);
      const LateEnvelopeSample &a = row[static_cast<std::size_t>(segment.left)], &b = row[static_cast<std::size_t>(segment.right)];
      const float from_density = read.left * a.density, to_density = segment.right < num_bins ? read.right * b.density : 0.f;
      if (from_density == 0.f && to_density == 0.f) continue;
      end_of_sound = segment.begin + static_cast<std::size_t>(segment.count);
      const auto carrier = [&](std::size_t c) { return carriers.loop(band, static_cast<int>(c), read.kind).data() + read.in_loop; };
      const Ramp density = ramp_over(segment, from_density, to_density);
      if (num_channels == 1) {
        add_omni(segment.count, density, carrier(0), out(0));
        continue;
      }
      // A silent end has no direction of its own.
      const int left_bin = from_density > 0.f ? segment.left : segment.right, right_bin = to_density > 0.f ? segment.right : segment.left;
      const LateEnvelopeSample &left = row[static_cast<std::size_t>(left_bin)], &right = row[static_cast<std::size_t>(right_bin)];
      const auto ramp = [&](float from, float to) { return ramp_over(segment, from, to); };
      bands[waits ? 1 : 0] = {
          {density, ramp(left.m[0], right.m[0]), ramp(left.m[1], right.m[1]), ramp(left.m[2], right.m[2]), ramp(left.d, right.d)},
          {carrier(0), carrier(1), carrier(2), carrier(3)}};
      if (waits) add_first_order(segment.count, bands, out(0), out(1), out(2), out(3));
      waits = !waits;
      const std::size_t higher = num_channels - 4;
      for (std::size_t c = 4; c < num_channels; ++c) {
        const HigherAmplitude& from = higher_[static_cast<std::size_t>(band * envelope.size() + left_bin) * higher + c - 4];
        const HigherAmplitude& to = higher_[static_cast<std::size_t>(band * envelope.size() + right_bin) * higher + c - 4];
        add_higher(segment.count, {density, ramp(from.m, to.m), ramp(from.d, to.d)}, carrier(0), carrier(c), out(c));
      }
    }
    if (waits) add_first_order(segment.count, bands[0], out(0), out(1), out(2), out(3));
  };
  envelope.visit(CarrierBank::kPad, [&](const LateSegment& segment) {
    if (segment.left >= num_bins) return;
    for (const LateCarriers::Read& read : place.reads(segment)) add(segment, read);
  });
  return end_of_sound;
}

}  // namespace earshot
