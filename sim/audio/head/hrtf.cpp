// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/hrtf.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "sim/audio/head/diffuse_decoder.h"
#include "sim/audio/head/head_grid.h"
#include "sim/audio/head/near_head.h"
#include "sim/audio/transforms/spectrum_math.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

int taps_for(float sample_rate_hz) { return lead_for(sample_rate_hz) + static_cast<int>(std::ceil(0.006 * sample_rate_hz)); }

}  // namespace

/// The spheres of a head, the nearest first, and what changes within the nearest and about the farthest.
struct Hrtf::Spheres {
  std::vector<HeadGrid> grids;
  NearHead inside, outside;

  Spheres(float sample_rate_hz, std::vector<HeadGrid> all)
      : grids(std::move(all)),
        inside(sample_rate_hz, grids.front().fft_size, grids.front().distance_m),
        outside(grids.size() == 1 ? inside : NearHead(sample_rate_hz, grids.back().fft_size, grids.back().distance_m)) {}

  /// Between two spheres linearly in the reciprocal of the distance, in which the field of a near source is linear at first.
  std::array<double, 2> write(glm::vec3 direction, double distance_m, std::span<std::complex<float>> left,
                              std::span<std::complex<float>> right) const {
    std::array<double, 2> delay{};
    std::size_t farther = 0;
    while (farther < grids.size() && grids[farther].distance_m < distance_m) ++farther;
    if (farther > 0 && farther < grids.size()) {
      const HeadGrid &low = grids[farther - 1], &high = grids[farther];
      const auto weight = static_cast<float>((1.0 / distance_m - 1.0 / high.distance_m) / (1.0 / low.distance_m - 1.0 / high.distance_m));
      low.write_aligned(direction, weight, false, delay, left, right);
      high.write_aligned(direction, 1.f - weight, true, delay, left, right);
      return delay;
    }
    (farther == 0 ? grids.front() : grids.back()).write_aligned(direction, 1.f, false, delay, left, right);
    if (NearHead::applies(distance_m))
      for (const int ear : {0, 1})
        delay[static_cast<std::size_t>(ear)] +=
            (farther == 0 ? inside : outside)
                .apply(distance_m, std::acos(std::clamp(cosine_at_ear(direction, ear), -1.0, 1.0)), ear == 0 ? left : right);
    return delay;
  }
};

Hrtf::Hrtf(float sample_rate_hz, std::vector<HeadGrid> spheres)
    : sample_rate_hz_(sample_rate_hz),
      fft_size_(spheres.front().fft_size),
      lead_samples_(lead_for(sample_rate_hz)),
      decoder_taps_(taps_for(sample_rate_hz)),
      spheres_(std::make_shared<const Spheres>(sample_rate_hz, std::move(spheres))) {
  const auto head = [this](glm::vec3 direction, std::span<std::complex<float>> left, std::span<std::complex<float>> right) {
    spheres_->grids.back().write(direction, left, right);
  };
  decoder_ = make_diffuse_decoder(head, fft_size_, sample_rate_hz_, lead_samples_, decoder_taps_);
}

void Hrtf::check_rate(float sample_rate_hz) {
  require(sample_rate_hz >= 4000.f && sample_rate_hz <= 384000.f, "hrtf sample_rate_hz", sample_rate_hz, "must be in [4000, 384000]");
}

std::shared_ptr<const Hrtf> Hrtf::rigid_sphere(float sample_rate_hz) {
  check_rate(sample_rate_hz);
  std::vector<HeadGrid> spheres(1, HeadGrid::rigid_sphere(sample_rate_hz));
  return std::shared_ptr<const Hrtf>(new Hrtf(sample_rate_hz, std::move(spheres)));
}

void Hrtf::spectra(glm::vec3 direction, std::span<std::complex<float>> left, std::span<std::complex<float>> right,
                   double extra_delay_samples, double distance_m) const {
  const std::array<double, 2> delay = aligned_spectra(direction, left, right, distance_m);
  const auto num_bins = static_cast<std::size_t>(fft_size_ / 2 + 1);
  for (std::size_t ear = 0; ear < 2; ++ear)
    delay_spectrum((ear == 0 ? left : right).first(num_bins), lead_samples_ + extra_delay_samples + delay[ear], fft_size_);
}

std::array<double, 2> Hrtf::aligned_spectra(glm::vec3 direction, std::span<std::complex<float>> left, std::span<std::complex<float>> right,
                                            double distance_m) const {
  EARSHOT_EXPECT(left.size() >= static_cast<std::size_t>(fft_size_ / 2 + 1) && right.size() >= static_cast<std::size_t>(fft_size_ / 2 + 1));
  return spheres_->write(direction, distance_m, left, right);
}

std::span<const std::complex<float>> Hrtf::diffuse_decoder(int channel, int ear) const {
  EARSHOT_EXPECT(channel >= 0 && channel < 4 && ear >= 0 && ear < 2);
  return decoder_[static_cast<std::size_t>(2 * channel + ear)];
}

}  // namespace earshot
