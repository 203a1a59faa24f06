#pragma once

#include <glm/vec3.hpp>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

namespace earshot {

/// Directional pattern of a source or a microphone in its own axes: x right, y up, front -z.  Pressure gain, 1 in front; negative where
/// the polarity is turned (back of a dipole).  Immutable.
class Directivity {
 public:
  virtual ~Directivity() = default;
  /// direction: unit, own axes; for a source the way the sound leaves, for a microphone the way it looks at the sound.
  [[nodiscard]] virtual float pressure(glm::vec3 direction, float frequency_hz) const = 0;
  /// Is the gain 1 everywhere?
  [[nodiscard]] virtual bool omnidirectional() const { return false; }

  /// a + (1 - a) cos: omni (a = 1), subcardioid 0.7, cardioid 0.5, supercardioid 0.37, hypercardioid 0.25, dipole 0 (ORACLES O-29).
  static std::shared_ptr<const Directivity> first_order(float omni_share);
  /// By name, one of those above.  Throws InputError with the nearest known name.
  static std::shared_ptr<const Directivity> named(std::string_view name);
};

/// A pattern tabulated for a set of frequencies, for hot loops.  Immutable, thread-safe.
class BandDirectivity {
 public:
  BandDirectivity(std::shared_ptr<const Directivity> pattern, std::span<const float> centre_hz);
  [[nodiscard]] bool omnidirectional() const { return omnidirectional_; }
  /// gain: [number of frequencies]; pressure gains toward `direction` (unit, own axes).
  void pressure(glm::vec3 direction, std::span<float> gain) const;

 private:
  std::shared_ptr<const Directivity> pattern_;
  std::vector<float> centre_hz_;
  bool omnidirectional_;
};

}  // namespace earshot
