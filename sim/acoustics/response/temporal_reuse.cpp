// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/response/temporal_reuse.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <utility>

#include "sim/acoustics/core/arrival.h"
#include "sim/acoustics/paths/line_of_sight.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

/// A directional source that turns by a radian counts as one that moves by this: its late level changes no faster.
constexpr float kMetresPerRadian = 0.5f;
/// From one frame's seed to the next: odd, and far from the small steps in which runs are numbered.
constexpr std::uint64_t kSeedStep = 0x9E3779B97F4A7C15;
constexpr double kSmoothing = 0.3;           // of the difference between new frames and the past, per frame
constexpr double kUnexplained = 3.5;         // standard errors
constexpr double kNoiseSmoothing = 0.15;     // of the noise of single frames, per frame
constexpr int kLevelsForNoise = 6;           // before that the noise is not known well enough to forget for it
constexpr double kDbPerNeper = 4.342944819;  // of energy: 10 log10(e)

/// Mean over bands of the level of the late energy, in dB; bands without energy have no part.  nullopt if there is none at all.
std::optional<double> level_db(const EnergyHistogram& late) {
  double sum_db = 0;
  int bands = 0;
  for (int band = 0; band < late.num_bands(); ++band) {
    double energy = 0;
    for (int bin = 0; bin < late.num_bins(); ++bin) energy += late.energy(bin, band);
    if (!(energy > 0)) continue;
    sum_db += 10.0 * std::log10(energy);
    ++bands;
  }
  return bands > 0 ? std::optional(sum_db / bands) : std::nullopt;
}

/// Mean time by which the late energy comes after the direct sound: the reciprocal of the decay constant, in a room.
double mean_delay_s(const EnergyHistogram& late, double direct_s) {
  double energy = 0, moment = 0;
  for (int bin = 0; bin < late.num_bins(); ++bin)
    for (int band = 0; band < late.num_bands(); ++band) {
      energy += late.energy(bin, band);
      moment += late.energy(bin, band) * (bin + 0.5);
    }
  const double least = late.bin_s();
  return energy > 0 ? std::max(least, moment / energy * late.bin_s() - direct_s) : std::numeric_limits<double>::infinity();
}

/// The late field without the walls near this pose, which the next pose may not have.
void take_out(const WallGain& gain, EnergyHistogram& late) {
  if (!gain.any) return;
  WallGain inverse;
  for (std::size_t band = 0; band < inverse.energy.size(); ++band) inverse.energy[band] = 1.f / gain.energy[band];
  late.scale(inverse.energy);
}

double angle_between(const glm::quat& a, const glm::quat& b) { return 2.0 * std::acos(std::min(1.0, std::fabs(double{glm::dot(a, b)}))); }

}  // namespace

void validate(const TemporalReuseConfig& config) {
  require(config.least_weight > 0.f && config.least_weight <= 1.f, "temporal reuse least_weight", config.least_weight, "must be in (0, 1]");
  require(config.max_bias_db > 0.f, "temporal reuse max_bias_db", config.max_bias_db, "must be positive");
  require(config.drift_db_per_m >= 0.f, "temporal reuse drift_db_per_m", config.drift_db_per_m, "must not be negative");
  require(config.max_move_m > 0.f, "temporal reuse max_move_m", config.max_move_m, "must be positive");
}

TemporalReuse::TemporalReuse(const TemporalReuseConfig& config) : config_(config) { validate(config_); }

bool TemporalReuse::continues(const Place& place, const EnergyHistogram& late) const {
  return frame_ > 0 && place.scene == before_.scene && place.in_sight == before_.in_sight &&
         glm::distance(place.source, before_.source) + glm::distance(place.listener, before_.listener) <= config_.max_move_m &&
         late.values().size() == past_.values().size();
}

double TemporalReuse::choose_weight(double drift_db) const {
  const double least =
      std::max({double{config_.least_weight}, past_variance_ / (1 + past_variance_), drift_db / (drift_db + config_.max_bias_db)});
  // Before the noise is measured, a typical value for a few rays in a room: about one dB (docs/explanation/estimators.md, section 10).
  const double noise_db2 = levels_ < kLevelsForNoise ? 1.0 : noise_db2_;
  const auto cost = [&](double a) { return std::pow(drift_db * (1 - a) / a, 2) + noise_db2 * a / (2 - a); };
  double best = least;
  constexpr int steps = 50;  // the cost is flat at its minimum
  for (int i = 1; i <= steps; ++i)
    if (const double a = least + (1 - least) * i / steps; cost(a) < cost(best)) best = a;
  return best;
}

void TemporalReuse::watch_level(const EnergyHistogram& late, bool moved) {
  const auto now_db = level_db(late), past_db = level_db(past_);
  if (!now_db || !past_db) return;
  if (levels_ >= 2) {
    // White noise of variance s^2 has second differences of variance 6 s^2; steady drift has none.
    const double second = *now_db - 2 * level_db_ + level_before_db_;
    const double weight = std::max(kNoiseSmoothing, 1.0 / (levels_ - 1));
    noise_db2_ += weight * (second * second / 6 - noise_db2_);
  }
  level_before_db_ = std::exchange(level_db_, *now_db);
  ++levels_;
  if (!moved) return;  // nothing can have changed
  difference_db_ = (1 - kSmoothing) * difference_db_ + kSmoothing * (*now_db - *past_db);
  difference_weight_ = (1 - kSmoothing) * (1 - kSmoothing) * difference_weight_ + kSmoothing * kSmoothing;
}

void TemporalReuse::blend(double shift_bins, EnergyHistogram& late) {
  const auto bins = late.num_bins();
  const std::size_t stride = static_cast<std::size_t>(late.num_bands()) * static_cast<std::size_t>(late.num_coefficients());
  const auto whole = static_cast<int>(std::floor(shift_bins));
  const auto fraction = static_cast<float>(shift_bins - whole);
  const auto a = static_cast<float>(weight_);
  const float* past = past_.values().data();
  float* out = late.values().data();
  for (int bin = 0; bin < bins; ++bin, out += stride) {
    const int from = bin - whole;  // and the one before it: split so that the mean time moves by just the shift
    const float* upper = from >= 0 && from < bins ? past + static_cast<std::size_t>(from) * stride : nullptr;
    const float* lower = from >= 1 && from <= bins ? past + static_cast<std::size_t>(from - 1) * stride : nullptr;
    for (std::size_t k = 0; k < stride; ++k) {
      const float shifted = (upper ? (1 - fraction) * upper[k] : 0.f) + (lower ? fraction * lower[k] : 0.f);
      out[k] = (1 - a) * shifted + a * out[k];
    }
  }
}

void TemporalReuse::compute(const AcousticScene& scene, const EarlyCandidates& candidates, glm::vec3 listener, EnergyResponse& response) {
  const Place place{.source = candidates.source(),
                    .listener = listener,
                    .orientation = candidates.sound_source().orientation,
                    .in_sight = in_line_of_sight(scene, candidates.source(), listener),
                    .scene = scene.hash()};
  if (!has_shape_of(scene, response.late)) response.late = make_histogram(scene);
  if (!continues(place, response.late)) {
    frame_ = 0;
    levels_ = 0;
    noise_db2_ = difference_db_ = difference_weight_ = 0;
  }
  if (frame_ == 0) {
    compute_energy_response(scene, candidates, listener, response);
    weight_ = 1;
  } else {
    const AcousticConfig& config = scene.config();
    seeded_ = scene.with_rays(config.rays, config.seed + frame_ * kSeedStep);
    compute_energy_response(*seeded_, candidates, listener, response);
    take_out(response.wall_gain, response.late);
    const double c = scene.speed_of_sound_m_per_s();
    const double direct_s = std::max(glm::distance(place.source, listener), kMinDistanceM) / c;
    const double before_s = std::max(glm::distance(before_.source, before_.listener), kMinDistanceM) / c;
    double move_m = glm::distance(place.source, before_.source) + glm::distance(listener, before_.listener);
    if (!candidates.emission().omnidirectional()) move_m += kMetresPerRadian * angle_between(place.orientation, before_.orientation);
    // A room's late level does not move with the direct sound, so the shift itself is a drift where the decay is steep.
    const double drift_db = config_.drift_db_per_m * move_m + kDbPerNeper * std::fabs(direct_s - before_s) / mean_delay_s(past_, before_s);
    const double shift_bins = (direct_s - before_s) / response.late.bin_s();
    watch_level(response.late, move_m > 0);
    weight_ = choose_weight(drift_db);
    const double standard_error_db = std::sqrt(difference_weight_ * noise_db2_ * (1 + past_variance_));
    if (levels_ > kLevelsForNoise && std::fabs(difference_db_) > kUnexplained * standard_error_db && difference_weight_ > 0) {
      weight_ = 1;
      difference_db_ = difference_weight_ = 0;
    }
    blend(shift_bins, response.late);
    response.batches.clear();
  }
  past_ = response.late;
  if (frame_ == 0) {
    take_out(response.wall_gain, past_);
    if (const auto level = level_db(past_)) {
      level_db_ = *level;
      levels_ = 1;
    }
  } else if (response.wall_gain.any) {
    response.late.scale(response.wall_gain.energy);
  }
  before_ = place;
  ++frame_;
  past_variance_ = (1 - weight_) * (1 - weight_) * past_variance_ + weight_ * weight_;
}

}  // namespace earshot
