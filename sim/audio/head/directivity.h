// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <glm/vec3.hpp>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "sim/base/text/config_key.h"

namespace earshot {

/// A band of frequencies; low_hz < centre_hz <= high_hz.
struct FrequencyRange {
  float low_hz, centre_hz, high_hz;
};

/// Directional pattern of a source or a microphone in its own axes: x right, y up, front -z.  Pressure gain, 1 in front; negative where
/// the polarity is turned (back of a dipole).  Immutable, thread-safe.
class Directivity {
 public:
  virtual ~Directivity() = default;
  /// direction: unit, own axes; for a source the way the sound leaves, for a microphone the direction toward the source of the sound.
  [[nodiscard]] virtual float pressure(glm::vec3 direction, float frequency_hz) const = 0;
  /// Whether the gain is 1 in all directions at all frequencies.
  [[nodiscard]] virtual bool omnidirectional() const { return false; }
  /// a of a pattern a + (1 - a) cos at all frequencies; nullopt for any other.
  [[nodiscard]] virtual std::optional<float> omni_weight() const { return std::nullopt; }
  /// Gains of a band at the nodes of AngleGrid: those at its centre, of a measured pattern what its lines in the band have
  /// (gridded_directivity.h).  at_nodes: [AngleGrid::kNodes].
  virtual void band_pressure(FrequencyRange band, std::span<float> at_nodes) const;

  /// a + (1 - a) cos: omni (a = 1), subcardioid 0.7, cardioid 0.5, supercardioid 0.37, hypercardioid 0.25, dipole 0
  /// (docs/evidence/oracles.md, O-29).
  static std::shared_ptr<const Directivity> first_order(float omni_weight);
  /// A talker: the mouth as a point on a rigid sphere of 8.75 cm (the model of Flanagan 1960, exact series), and, as a sphere has no torso
  /// and no hair, a loss of 10 dB times angle / 180 degrees that sets in with the shadow of the sphere, as (ka)^2 / (1 + (ka)^2).  With it
  /// A-weighted speech has Q = 2.5, the usual value of a talker.  Behind it is 6 dB weaker than in front, where measured talkers are
  /// quoted with up to 10 dB: expect errors of up to 4 dB there.  Symmetric about its axis: no lobe below the mouth.
  static std::shared_ptr<const Directivity> voice();
  /// A measured balloon: YAML or JSON with `frequencies_hz` [F] rising, `azimuths_deg` [A] rising within one turn, counter-clockwise from
  /// the front seen from above, `elevations_deg` [E] rising within [-90, 90] and `gains_db` [F][E][A]; `name` and `source` are free text.
  /// Gains are made relative to the front of each frequency.  Interpolated linearly in dB over angles and log frequency, continuous across
  /// the seam and the poles (where rows that end before a pole go on as the mean of the last one); the end values hold outside the
  /// frequencies.  Magnitudes only.  Throws InputError naming file and key.
  static std::shared_ptr<const Directivity> balloon(const std::filesystem::path& path);
  /// The same from text; where: how messages name it.
  static std::shared_ptr<const Directivity> balloon_from_text(std::string_view text, const std::string& where);
  /// All keys of such a file.
  static std::vector<ConfigKey> balloon_keys();
  /// omni to dipole, voice, or a path: a balloon (.json, .yaml, .yml), SOFA (.sofa) or CLF text (.tab, .txt, .clf, .cf1, .cf2).
  static std::shared_ptr<const Directivity> named(std::string_view name);
  /// Whether named() takes the name as the path of a file.
  static bool is_file(std::string_view name);
};

/// A pattern ready for a set of bands and hot loops: first-order patterns are evaluated, others are read off a grid of 5 degrees
/// (angle_grid.h; exact on the grid, so at the nodes of any balloon of 5, 10, 15 or 30 degrees).  Immutable, thread-safe.
class BandDirectivity {
 public:
  /// centre_hz, edge_hz: [number of bands] and one more, as those of BandLayout.  No edges: gains at the centres alone.
  BandDirectivity(std::shared_ptr<const Directivity> pattern, std::span<const float> centre_hz, std::span<const float> edge_hz);
  [[nodiscard]] bool omnidirectional() const { return omni_weight_ == 1.f; }
  /// gain: [number of bands]; pressure gains toward `direction` (unit, own axes).
  void pressure(glm::vec3 direction, std::span<float> gain) const;

 private:
  std::optional<float> omni_weight_;
  std::size_t num_bands_;
  std::vector<float> table_;  ///< [node of AngleGrid][band], empty for first order
};

}  // namespace earshot
