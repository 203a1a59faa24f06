// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/synthesis/late_array.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>

#include "sim/audio/transforms/spectrum_math.h"

namespace earshot {
namespace {

using Complex = std::complex<float>;

/// A narrower cone than this would fall between the waves, which are 21 degrees apart.
constexpr double kMaxConcentration = 20.0;
/// Room around the response for what delays and patterns ring, beside the size of the array.
constexpr double kGuardS = 0.01;
/// Slowest sound that the room is laid out for.
constexpr float kMinSpeedMPerS = 200.f;

std::vector<glm::vec3> spread_directions(int count) {
  std::vector<glm::vec3> directions;
  for (int i = 0; i < count; ++i) {  // spherical Fibonacci points
    const double height = (2.0 * i + 1.0) / count - 1.0, radius = std::sqrt(1.0 - height * height);
    const double angle = 2.0 * std::numbers::pi * std::fmod(i * std::numbers::phi, 1.0);
    directions.emplace_back(radius * std::cos(angle), height, radius * std::sin(angle));
  }
  return directions;
}

float largest_offset_m(const std::vector<Microphone>& microphones) {
  float largest = 0;
  for (const Microphone& microphone : microphones) largest = std::max(largest, glm::length(microphone.position_m));
  return largest;
}

std::size_t guard_for(float rate_hz, float largest_offset_m) {
  return static_cast<std::size_t>(
      std::ceil(static_cast<double>(rate_hz) * (kGuardS + static_cast<double>(largest_offset_m / kMinSpeedMPerS))));
}

}  // namespace

LateArray::LateArray(const BandLayout& bands, float sample_rate_hz, int num_samples, const std::vector<Microphone>& microphones)
    : microphones_(microphones),
      num_bands_(bands.size()),
      rate_hz_(sample_rate_hz),
      num_samples_(static_cast<std::size_t>(num_samples)),
      guard_(guard_for(sample_rate_hz, largest_offset_m(microphones))),
      fft_(next_power_of_two(static_cast<int>(num_samples_ + 2 * guard_))),
      filters_(bands, sample_rate_hz, fft_.size()),
      direction_(spread_directions(kNumWaves)),
      signal_(static_cast<std::size_t>(fft_.size())),
      wave_spectrum_(static_cast<std::size_t>(fft_.num_bins())),
      path_(wave_spectrum_.size()),
      microphone_spectrum_(microphones.size(), std::vector<Complex>(wave_spectrum_.size())),
      band_gain_(static_cast<std::size_t>(num_bands_)),
      gain_(wave_spectrum_.size()) {}

/// Weights of the waves in every bin and band.
void LateArray::weigh_waves(const EnergyHistogram& energy) {
  weight_.resize(static_cast<std::size_t>(energy.num_bands() * envelope_.size()) * kNumWaves);
  for (int band = 0; band < energy.num_bands(); ++band) {
    const auto row = envelope_.band(band);
    for (int bin = 0; bin < envelope_.size(); ++bin) {
      const auto& m = row[static_cast<std::size_t>(bin)].m;
      // ACN 1 to 3 are (y, z, x) of the ambisonic axes: (-x, y, -z) of the world.
      const glm::vec3 mean = glm::vec3(-m[0], m[1], -m[2]) / std::numbers::sqrt3_v<float>;
      const double length = std::min(static_cast<double>(glm::length(mean)), 1.0);
      float* weight = weight_.data() + static_cast<std::size_t>(band * envelope_.size() + bin) * kNumWaves;
      if (length < 1e-6) {
        std::fill_n(weight, kNumWaves, 1.f / kNumWaves);
        continue;
      }
      // Banerjee et al. 2005, eq. 4.4, for three dimensions: within 2 % of the exact inverse of coth k - 1 / k.
      const double k = std::min(length * (3.0 - length * length) / std::max(1.0 - length * length, 1e-6), kMaxConcentration);
      double sum = 0;
      std::array<double, kNumWaves> density;
      for (std::size_t i = 0; i < kNumWaves; ++i)
        sum += density[i] = std::exp(k * (static_cast<double>(glm::dot(direction_[i], mean)) / length - 1.0));
      for (std::size_t i = 0; i < kNumWaves; ++i) weight[i] = static_cast<float>(density[i] / sum);
    }
  }
}

/// Writes wave `wave` as it passes the listener's position to signal_, `guard_` samples late.  ahead: samples by which its noise comes
/// earlier there than at the origin, modulo the length of the loops.
void LateArray::sound_wave(const EnergyHistogram& energy, const CarrierBank& carriers, LateCarriers& place, std::size_t wave,
                           std::size_t ahead) {
  std::fill(signal_.begin(), signal_.end(), 0.f);
  const auto add = [&](const LateSegment& segment, const LateCarriers::Read& read) {
    const std::size_t in_loop = (read.in_loop + ahead) & (carriers.length() - 1);
    for (int band = 0; band < energy.num_bands(); ++band) {
      const auto row = envelope_.band(band);
      const auto density_at = [&](int bin) {
        return row[static_cast<std::size_t>(bin)].density *
               weight_[static_cast<std::size_t>(band * envelope_.size() + bin) * kNumWaves + wave];
      };
      const Ramp density = ramp_over(segment, read.left * density_at(segment.left), read.right * density_at(segment.right));
      const float* noise = carriers.loop(band, static_cast<int>(wave)).data() + in_loop;
      float* out = signal_.data() + guard_ + segment.begin;
      for (int i = 0; i < segment.count; ++i) out[i] += std::sqrt(std::max(density.at(i), 0.f)) * noise[i];
    }
  };
  envelope_.visit(CarrierBank::kPad, [&](const LateSegment& segment) {
    for (const LateCarriers::Read& read : place.reads(segment)) add(segment, read);
  });
}

void LateArray::render(const LateFieldAtArray& field, const CarrierBank& carriers, LateCarriers& place,
                       std::span<const BandDirectivity> patterns, std::span<float> out) {
  if (field.energy.num_bins() == 0) return;
  const CarrierKey& key = field.key;
  const auto speed_m_per_s = static_cast<double>(field.speed_of_sound_m_per_s);
  envelope_.make(field.energy, rate_hz_, field.onset_sample, num_samples_);
  weigh_waves(field.energy);
  for (auto& spectrum : microphone_spectrum_) std::fill(spectrum.begin(), spectrum.end(), Complex{});
  for (std::size_t wave = 0; wave < kNumWaves; ++wave) {
    // A wave reaches a place on its own side earlier: whole samples are read ahead, the rest is a delay.  The place has no part in `place`.
    const double ahead = glm::dot(glm::dvec3(direction_[wave]), glm::dvec3(key.listener.value_or(glm::vec3(0)))) / speed_m_per_s *
                         static_cast<double>(rate_hz_);
    const auto loop = static_cast<double>(carriers.length());
    const double whole = std::floor(ahead);
    place.set({key.source, std::nullopt, key.moving_source}, kFirstStream + static_cast<std::uint32_t>(wave), envelope_);
    sound_wave(field.energy, carriers, place, wave, static_cast<std::size_t>(whole - loop * std::floor(whole / loop)));
    fft_.forward(signal_, wave_spectrum_);
    const glm::vec3 from = field.orientation.world_to_local(direction_[wave]);
    for (std::size_t i = 0; i < microphones_.size(); ++i) {
      const Microphone& microphone = microphones_[i];
      patterns[i].pressure(glm::conjugate(microphone.orientation) * from, band_gain_);
      std::copy(wave_spectrum_.begin(), wave_spectrum_.end(), path_.begin());
      const bool flat = std::all_of(band_gain_.begin(), band_gain_.end(), [&](float gain) { return gain == band_gain_[0]; });
      if (flat) {
        for (Complex& bin : path_) bin *= band_gain_[0];
      } else {
        filters_.blend(band_gain_, gain_);
        for (std::size_t k = 0; k < path_.size(); ++k) path_[k] *= gain_[k];
      }
      // A wave from the side of the microphone reaches it before the listener's position.
      const double early_samples =
          static_cast<double>(glm::dot(from, microphone.position_m)) / speed_m_per_s * static_cast<double>(rate_hz_);
      delay_spectrum(path_, whole - ahead - early_samples, fft_.size());
      for (std::size_t k = 0; k < path_.size(); ++k) microphone_spectrum_[i][k] += path_[k];
    }
  }
  for (std::size_t i = 0; i < microphones_.size(); ++i) {
    fft_.inverse(microphone_spectrum_[i], signal_);
    float* samples = out.data() + i * num_samples_;
    for (std::size_t n = 0; n < num_samples_; ++n) samples[n] += signal_[guard_ + n];
  }
}

}  // namespace earshot
