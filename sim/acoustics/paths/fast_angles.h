// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

namespace earshot {

/// The four terms of a wedge side by side.
using FourNumbers = double __attribute__((vector_size(32)));
struct FourPhases {
  FourNumbers cosine, sine;
};

/// exp(j angle) within 1e-11 for |angle| < 1e6: Taylor's series about the nearest quarter turn.  About 6 ns for all four, as much as one
/// std::sin.
inline FourPhases fast_unit_phase(const FourNumbers& angle) {
  using Integers = std::int64_t __attribute__((vector_size(32)));
  constexpr double quarters_per_rad = 0.63661977236758134, quarter_rad = 1.5707963267948966, rest_rad = 6.123233995736766e-17;
  constexpr double ulp_is_one = 6755399441055744.0;  // the low bits of a sum with it are those of the nearest whole number
  const FourNumbers shifted = angle * quarters_per_rad + ulp_is_one, quarters = shifted - ulp_is_one;
  Integers quarter;
  std::memcpy(&quarter, &shifted, sizeof quarter);
  const FourNumbers x = (angle - quarters * quarter_rad) - quarters * rest_rad, y = x * x;
  const FourNumbers sine = x * (1 - y * (1.0 / 6 - y * (1.0 / 120 - y * (1.0 / 5040 - y * (1.0 / 362880 - y * (1.0 / 39916800))))));
  const FourNumbers cosine =
      1 - y * (1.0 / 2 - y * (1.0 / 24 - y * (1.0 / 720 - y * (1.0 / 40320 - y * (1.0 / 3628800 - y * (1.0 / 479001600))))));
  const Integers odd = (quarter & 1) != 0;
  const FourNumbers real = odd ? sine : cosine, imag = odd ? cosine : sine;
  return {((quarter + 1) & 2) != 0 ? -real : real, (quarter & 2) != 0 ? -imag : imag};
}

/// atan2(y, x) for x >= 0 within 2e-8 rad (Abramowitz and Stegun 1964, 4.4.49); 0 at the origin.  4 ns, a fifth of std::atan2.
inline double fast_atan2(double y, double x) {
  const double height = std::abs(y), most = height < x ? x : height;
  if (!(most > 0)) return 0;
  const double t = (height < x ? height : x) / most, s = t * t;
  const double angle =
      t * (1 + s * (-0.3333314528 +
                    s * (0.1999355085 +
                         s * (-0.1420889944 +
                              s * (0.1065626393 + s * (-0.0752896400 + s * (0.0429096138 + s * (-0.0161657367 + s * 0.0028662257))))))));
  return std::copysign(height < x ? angle : 1.5707963267948966 - angle, y);
}

}  // namespace earshot
