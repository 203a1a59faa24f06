// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <numbers>

#include "sim/base/processor.h"

namespace earshot {

/// Eight frequency bands side by side.  An edge acts on all bands alike, so the terms of diffraction are computed for eight at once.
/// Single precision, except for the phases of long ways.
inline constexpr std::size_t kLanes = 8;
using Lanes = EightFloats;
using LaneIntegers = std::int32_t __attribute__((vector_size(4 * kLanes)));

struct ComplexLanes {
  Lanes real{}, imag{};
};

inline Lanes all_lanes(float value) { return Lanes{} + value; }
inline ComplexLanes operator+(const ComplexLanes& a, const ComplexLanes& b) { return {a.real + b.real, a.imag + b.imag}; }
inline ComplexLanes operator-(const ComplexLanes& a, const ComplexLanes& b) { return {a.real - b.real, a.imag - b.imag}; }
inline ComplexLanes operator*(const Lanes& a, const ComplexLanes& b) { return {a * b.real, a * b.imag}; }
inline ComplexLanes operator*(const ComplexLanes& a, const ComplexLanes& b) {
  return {a.real * b.real - a.imag * b.imag, a.real * b.imag + a.imag * b.real};
}
inline ComplexLanes conj(const ComplexLanes& a) { return {a.real, -a.imag}; }
inline Lanes norm(const ComplexLanes& a) { return a.real * a.real + a.imag * a.imag; }
inline bool all_zero(const Lanes& x) {
  bool any_nonzero = false;
  for (std::size_t lane = 0; lane < kLanes; ++lane) any_nonzero = any_nonzero || x[lane] != 0.f;
  return !any_nonzero;
}
inline Lanes choose(LaneIntegers condition, const Lanes& yes, const Lanes& no) { return condition ? yes : no; }
inline ComplexLanes choose(LaneIntegers condition, const ComplexLanes& yes, const ComplexLanes& no) {
  return {condition ? yes.real : no.real, condition ? yes.imag : no.imag};
}

/// The nearest whole number, for |x| < 4e6.
inline Lanes nearest(const Lanes& x) {
  constexpr float ulp_is_one = 12582912.f;
  return (x + ulp_is_one) - ulp_is_one;
}

/// exp(j angle) within 3e-7 for |angle| < 100.
inline ComplexLanes unit_phase(const Lanes& angle) {
  const Lanes quarters = nearest(angle * 0.636619772f);
  const Lanes x = ((angle - quarters * 1.5703125f) - quarters * 4.837512970e-4f) - quarters * 7.549790126e-8f, y = x * x;
  const Lanes sine = x * (1.f + y * (-1.6666655e-1f + y * (8.3321609e-3f + y * -1.9515296e-4f)));
  const Lanes cosine = 1.f - 0.5f * y + y * y * (4.1666646e-2f + y * (-1.3887316e-3f + y * 2.4433157e-5f));
  const LaneIntegers quarter = __builtin_convertvector(quarters, LaneIntegers);
  const LaneIntegers odd = (quarter & 1) != 0;
  const Lanes real = odd ? sine : cosine, imag = odd ? cosine : sine;
  return {((quarter + 1) & 2) != 0 ? -real : real, (quarter & 2) != 0 ? -imag : imag};
}

/// exp(x) within 2e-7 of itself, for x <= 0; exp(-87) below that.
inline Lanes exp_of_negative(Lanes x) {
  x = x < -87.f ? all_lanes(-87.f) : x;
  const Lanes octaves = nearest(x * 1.44269504f);
  const Lanes r = (x - octaves * 0.693359375f) + octaves * 2.12194440e-4f;
  const Lanes rest = 1.f + r * (1.f + r * (0.5f + r * (1.66666655e-1f + r * (4.16657960e-2f + r * (8.33345205e-3f + r * 1.39819598e-3f)))));
  const LaneIntegers bits = (__builtin_convertvector(octaves, LaneIntegers) + 127) << 23;
  Lanes power;
  std::memcpy(&power, &bits, sizeof power);
  return rest * power;
}

/// Argument in [-pi, pi] within 3e-7 (Abramowitz and Stegun 1964, 4.4.49); 0 at the origin.
inline Lanes argument(const ComplexLanes& z) {
  const Lanes x = z.real < 0.f ? -z.real : z.real, y = z.imag < 0.f ? -z.imag : z.imag;
  const Lanes most = x < y ? y : x, least = x < y ? x : y;
  const Lanes t = least / (most < 1e-30f ? all_lanes(1e-30f) : most), s = t * t;
  Lanes angle = s * (0.0429096138f + s * (-0.0161657367f + s * 0.0028662257f));
  angle = s * (-0.1420889944f + s * (0.1065626393f + s * -0.0752896400f + s * angle));
  angle = t * (1.f + s * (-0.3333314528f + s * 0.1999355085f + s * angle));
  angle = x < y ? 1.57079633f - angle : angle;
  angle = z.real < 0.f ? 3.14159265f - angle : angle;
  return z.imag < 0.f ? -angle : angle;
}

/// Exact as std::sqrt.
inline Lanes root_of(Lanes x) {
  take_roots(x);
  return x;
}

/// Wavenumbers of eight bands, ascending, in 1/m.
struct WaveLanes {
  explicit WaveLanes(const std::array<double, kLanes>& wavenumber_per_m) : exact(wavenumber_per_m) {
    for (std::size_t lane = 0; lane < kLanes; ++lane) number[lane] = static_cast<float>(exact[lane]);
    root = root_of(number);
  }
  /// exp(j k way), for ways of up to 1e6 waves.
  [[nodiscard]] ComplexLanes turn(double way_m) const {
    constexpr double per_turn = 0.5 * std::numbers::inv_pi, turn_rad = 2.0 * std::numbers::pi;
    Lanes angle;
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const double turns = exact[lane] * way_m * per_turn;
      angle[lane] = static_cast<float>((turns - std::nearbyint(turns)) * turn_rad);
    }
    return unit_phase(angle);
  }
  std::array<double, kLanes> exact;
  Lanes number, root;  ///< k and sqrt(k)
};

}  // namespace earshot
