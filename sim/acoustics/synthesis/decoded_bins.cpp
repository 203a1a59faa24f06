// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/synthesis/decoded_bins.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace earshot {
namespace {

/// The binaural late tail gives its ears the right powers and correlation, but the time between them of a diffuse field.  So of a tail the
/// more is decoded the longer its mean direction, from nothing to all between these two.
constexpr float kDiffuseTail = 0.15f, kDirectionalTail = 0.25f;
/// Of the energy of a tail that is decoded, the part that the binaural late tail still makes.
constexpr float kTailOfTail = 0.01f;

}  // namespace

int bins_to_decode(const LateEnvelope& envelope, double decode_samples, std::vector<float>& before) {
  const int first = envelope.bin_from(envelope.first_sound() + decode_samples);
  if (first >= envelope.size() || !(decode_samples > 0)) return first;
  envelope.energy_before(before);
  const float end = before.back(), left = end - before[static_cast<std::size_t>(first)];
  std::array<float, 3> mean{};
  for (auto bin = static_cast<std::size_t>(first); bin + 1 < before.size(); ++bin) {
    float density = 0;
    std::array<float, 3> sum{};
    for (int band = 0; band < envelope.num_bands(); ++band) {
      const LateEnvelopeSample& sample = envelope.band(band)[bin];
      density += sample.density;
      for (std::size_t i = 0; i < 3; ++i) sum[i] += sample.density * sample.m[i];
    }
    if (density > 0.f)
      for (std::size_t i = 0; i < 3; ++i) mean[i] += (before[bin + 1] - before[bin]) * (sum[i] / density);
  }
  // N3D: sqrt 3 times the mean direction.
  const float square = (mean[0] * mean[0] + mean[1] * mean[1] + mean[2] * mean[2]) / 3.f;
  const float length = left > 0.f ? std::sqrt(square) / left : 0.f;
  const float way = std::clamp((length - kDiffuseTail) / (kDirectionalTail - kDiffuseTail), 0.f, 1.f);
  if (way == 0.f) return first;
  // No slope at either end: the last bin passes the bins in about equal steps of the direction.
  const float decoded = way * way * (3.f - 2.f * way) * (1.f - kTailOfTail);
  int last = first;
  while (last < envelope.size() && before[static_cast<std::size_t>(last)] < end - (1.f - decoded) * left) ++last;
  return last;
}

}  // namespace earshot
