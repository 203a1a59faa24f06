// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/metrics/rir_measurement.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "sim/acoustics/metrics/signal_energy.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

void require_samples(std::span<const float> samples, const char* name) {
  require(!samples.empty(), name, samples.size(), "has no samples to measure");
  require(samples.size() <= (std::size_t{1} << 23), name, samples.size(), "is longer than 2^23 samples");
  const auto bad = std::find_if(samples.begin(), samples.end(), [](float value) { return !std::isfinite(value); });
  if (bad != samples.end()) require(false, name, *bad, "must be finite");
}

void check_times(std::span<const float> rir, double sample_rate_hz, const RirMeasurement& how, const MeasurementNames& names) {
  if (how.direct_delay_s) {
    const double delay_s = *how.direct_delay_s;
    require(delay_s >= 0 && std::isfinite(delay_s), names.direct_delay, delay_s, "must be at least 0");
    if (!(delay_s * sample_rate_hz < static_cast<double>(rir.size())))
      throw InputError(
          names.direct_delay,
          fmt::format("is {:g} s, but the response ends after {:g} s", delay_s, static_cast<double>(rir.size()) / sample_rate_hz),
          "give a time within the response, or leave it out");
  }
  if (how.distance_m) require(*how.distance_m > 0 && std::isfinite(*how.distance_m), names.distance, *how.distance_m, "must be positive");
}

void check_lateral(std::span<const float> rir, const RirMeasurement& how, const MeasurementNames& names) {
  if (how.lateral.empty()) return;
  if (!how.request.lateral)
    throw InputError(names.lateral, "has no effect without lateral parameters", fmt::format("add lateral to {}", names.parameters));
  require_samples(how.lateral, names.lateral);
  require(how.lateral.size() == rir.size(), names.lateral, how.lateral.size(), "must have as many samples as the response");
  if (energy_of(rir) > 0 && std::equal(rir.begin(), rir.end(), how.lateral.begin()))
    throw InputError(names.lateral, "is the measured response itself", "give the response of a figure-of-eight microphone beside it");
}

}  // namespace

void check_measurement(std::span<const float> rir, double sample_rate_hz, const RirMeasurement& how, const MeasurementNames& names) {
  require_samples(rir, names.rir);
  check_times(rir, sample_rate_hz, how, names);
  check_lateral(rir, how, names);
  if (how.reference_10m.empty()) return;
  if (how.is_green) throw InputError(names.reference, fmt::format("is given together with {}", names.green), "give one of them");
  require_samples(how.reference_10m, names.reference);
  require(energy_of(how.reference_10m) > 0, names.reference, 0, "must not be silent");
}

}  // namespace earshot
