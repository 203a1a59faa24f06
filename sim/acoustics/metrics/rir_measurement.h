// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

#include "sim/acoustics/metrics/parameter_request.h"

namespace earshot {

/// Bands of a response in samples.
enum class MeasuredBands { octaves, third_octaves };

/// Reading of a response in samples.
struct RirMeasurement {
  std::optional<double> direct_delay_s = std::nullopt;  ///< time of the direct sound; nullopt: that of the onset (onset.h)
  bool has_direct = true;  ///< false: the first sound counts as reverberation, as in an energy response without line of sight
  MeasuredBands bands = MeasuredBands::octaves;
  bool low_octave = false;  ///< octaves from 63 Hz instead of 125 Hz
  ParameterRequest request{};
  /// Response of a figure-of-eight microphone at the same place with its null toward the source and the sensitivity of the other one on its
  /// axis, of equal length.  Lateral parameters need it.
  std::span<const float> lateral{};
  /// Response of the same source and microphone at 10 m in a free field, at the same rate: the reference of G and LG.  Without it both are
  /// missing unless is_green.
  std::span<const float> reference_10m{};
  bool is_green = false;                            ///< the samples are known to be in Green units
  std::optional<double> distance_m = std::nullopt;  ///< of the source, for stage parameters; nullopt: taken as 1 m
  bool without_noise = false;  ///< the noise at the end of a record gives way to the decay before it, band by band (noise_tail.h)
};

/// What messages call the parts of a measurement.
struct MeasurementNames {
  const char *rir = "rir", *direct_delay = "direct_delay_s", *distance = "distance_m", *lateral = "lateral", *reference = "reference",
             *green = "green_units", *parameters = "parameters";
};

/// Throws InputError for samples that are not finite, a time of the direct sound outside the response, a distance that is not positive, a
/// lateral response without lateral parameters, of another length or equal to the response itself, a silent reference, and a reference
/// for samples in Green units.  O(samples).
void check_measurement(std::span<const float> rir, double sample_rate_hz, const RirMeasurement& how, const MeasurementNames& names = {});

}  // namespace earshot
