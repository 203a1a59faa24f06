// SPDX-License-Identifier: Apache-2.0
#pragma once

/// @file
/// Impulse responses, and what they are made of: paths and late energy.

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "earshot/metrics.h"
#include "earshot/vec3.h"

namespace earshot::api {

/// Room impulse response: pressure in Green units (a unit source gives 1 / (4 pi r) at distance r).  Sample n is n / rate after emission.
struct Rir {
  int num_channels = 0, num_samples = 0;
  double sample_rate_hz = 0;
  std::vector<float> samples;  ///< [num_channels, num_samples]
  /// Loudspeakers of the channels of quad and surround, for the header of a WAV file: dwChannelMask of WAVEFORMATEXTENSIBLE.  0: none.
  std::uint32_t channel_mask = 0;

  /// Samples of one channel, [num_samples].
  [[nodiscard]] std::span<const float> channel(int index) const {
    return std::span(samples).subspan(static_cast<std::size_t>(index) * static_cast<std::size_t>(num_samples),
                                      static_cast<std::size_t>(num_samples));
  }
};

/// How a path gets from the source to the listener.
enum class ArrivalKind : std::uint8_t { direct, reflection, diffraction, transmission };

/// One deterministic path.
struct Arrival {
  ArrivalKind kind = ArrivalKind::direct;
  int order = 0;               ///< number of reflections, edges or walls
  std::uint64_t identity = 0;  ///< of the planes or edges: the same path at another pose has the same number
  double delay_s = 0;          ///< after emission
  double distance_m = 0;
  Vec3 direction, departure;         ///< unit: from the listener toward the sound, and from the source along the path
  std::span<const float> amplitude;  ///< [bands], pressure in Green units; valid as long as a copy of the response lives
  std::span<const float> phase_rad;  ///< [bands], beyond that of the delay
};

/// Energy of the late field by time, band and harmonic of the arrival direction.  Green units; time counts from emission.
struct LateEnergy {
  int num_bins = 0, num_bands = 0, num_harmonics = 0;
  double bin_s = 0;
  std::span<const float> values;  ///< [bins, bands, harmonics]; harmonic 0 is the energy.  Valid as long as a copy of the response lives

  [[nodiscard]] float energy(int bin, int band) const {
    return values[(static_cast<std::size_t>(bin) * static_cast<std::size_t>(num_bands) + static_cast<std::size_t>(band)) *
                  static_cast<std::size_t>(num_harmonics)];
  }
};

/// Orientation and channels of a listener.
struct RenderOptions {
  double heading_deg = 0;  ///< counter-clockwise from -z, seen from above
  double pitch_deg = 0;    ///< upwards
  double roll_deg = 0;     ///< right ear down
  /// mono[:PATTERN], stereo[:xy|:ms|:ab|:ortf], binaural, quad, surround_5_1, surround_7_1, ambisonic:ORDER[:n3d|:sn3d][:world|:ego], or
  /// array:FILE.  Empty: binaural, or the channels that a Response was asked for.
  std::string channels = {};
  std::string hrtf = {};  ///< SOFA file of head filters, for binaural; empty: a rigid sphere
};

/// What one listener receives from one source, before any head or microphone.  It does not depend on the listener's orientation, so that
/// render() for another heading is cheap (0.2 ms for 1.5 s, binaural, 16 kHz).  Copies share the data.  Safe from any thread.
class Response {
 public:
  [[nodiscard]] const std::vector<Arrival>& arrivals() const;  ///< by distance
  [[nodiscard]] LateEnergy late() const;
  /// From the energy of the response: exact times, without the noise of rendered sound.
  [[nodiscard]] Metrics metrics() const;
  /// The same with further parameters.  Lateral ones need harmonics (settings sh_order=4).
  /// @throws InputError for an unknown group.
  [[nodiscard]] Metrics measure(const ParameterOptions& parameters) const;
  /// Standard errors of the values of measure(), each in the field of its value; NaN where it is not known.  Twice an error covers 95 % of
  /// seeds.  Costs one more trace at most, with a source field its photons twice more; `interaural` also 16 renders for two ears of the
  /// orientation and head of `ears`.
  [[nodiscard]] Metrics standard_errors(const ParameterOptions& parameters = {}, const RenderOptions& ears = {}) const;
  [[nodiscard]] double speed_of_sound_m_per_s() const;
  /// Fraction of the traced rays that carry energy to the end, in [0, 1]: low values mean noisy late sound.
  [[nodiscard]] double ray_efficiency() const;
  /// The impulse response for a listener of this orientation.
  /// @throws InputError for unknown channels, or channels that need harmonics the response was computed without.
  [[nodiscard]] Rir render(const RenderOptions& options = {}) const;

  struct Model;
  explicit Response(std::shared_ptr<const Model> model) : model_(std::move(model)) {}  ///< for the library

 private:
  std::shared_ptr<const Model> model_;
};

}  // namespace earshot::api
