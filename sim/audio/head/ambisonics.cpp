// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/ambisonics.h"

#include <array>
#include <cmath>
#include <numbers>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr std::size_t acn(int l, int m) { return static_cast<std::size_t>(l * (l + 1) + m); }

/// Factors of the recursion P(l, m) = a (z P(l-1, m) - b P(l-2, m)) of fully normalized associated Legendre functions (Holmes and
/// Featherstone 2002, eqs. 11 to 13).  No factorials, so no overflow at any order.
struct Recursion {
  std::array<std::array<double, kMaxAmbisonicOrder + 1>, kMaxAmbisonicOrder + 1> a{}, b{};
  std::array<double, kMaxAmbisonicOrder + 1> sectoral{};  ///< P(m, m) / P(m-1, m-1)
  Recursion() {
    for (int m = 1; m <= kMaxAmbisonicOrder; ++m) sectoral[m] = std::sqrt((m == 1 ? 2.0 : 1.0) * (2.0 * m + 1) / (2.0 * m));
    for (int l = 1; l <= kMaxAmbisonicOrder; ++l) {
      for (int m = 0; m < l; ++m) {
        a[l][m] = std::sqrt((4.0 * l * l - 1) / (1.0 * l * l - m * m));
        b[l][m] = l < 2 ? 0.0 : std::sqrt(((l - 1.0) * (l - 1.0) - m * m) / (4.0 * (l - 1.0) * (l - 1.0) - 1));
      }
    }
  }
};

}  // namespace

void spherical_harmonics_n3d(glm::vec3 direction, int order, std::span<float> values) {
  EARSHOT_EXPECT(order >= 0 && order <= kMaxAmbisonicOrder && values.size() >= acn(order + 1, -order - 1));
  values[0] = 1.f;
  if (order == 0) return;
  // The path tracer evaluates order 1 at every hit.
  constexpr float sqrt3 = std::numbers::sqrt3_v<float>;
  values[1] = -sqrt3 * direction.x;
  values[2] = sqrt3 * direction.y;
  values[3] = -sqrt3 * direction.z;
  if (order == 1) return;

  static const Recursion recursion;
  const double x = -direction.z, y = -direction.x, z = direction.y;
  // Real and imaginary part of (x + iy)^m carry the azimuth and the factor cos(elevation)^m, so the poles need no special case.
  double cosine = 1, sine = 0, sectoral = 1;
  for (int m = 0; m <= order; ++m) {
    if (m > 0) {
      const double turned = cosine * x - sine * y;
      sine = cosine * y + sine * x;
      cosine = turned;
      sectoral *= recursion.sectoral[m];
    }
    double before = 0, current = sectoral;
    for (int l = m; l <= order; ++l) {
      if (l > m) {
        const double next = recursion.a[l][m] * (z * current - recursion.b[l][m] * before);
        before = current;
        current = next;
      }
      values[acn(l, m)] = static_cast<float>(current * cosine);
      if (m > 0) values[acn(l, -m)] = static_cast<float>(current * sine);
    }
  }
}

float sn3d_from_n3d(int channel) {
  EARSHOT_EXPECT(channel >= 0);
  int order = 0;
  while ((order + 1) * (order + 1) <= channel) ++order;
  return 1.f / std::sqrt(2.f * static_cast<float>(order) + 1.f);
}

glm::vec3 to_head_axes(glm::vec3 world, double heading_rad) {
  const double cosine = std::cos(heading_rad), sine = std::sin(heading_rad);
  // The head's right is (cos, 0, -sin), its back (sin, 0, cos).
  return {static_cast<float>(cosine * world.x - sine * world.z), world.y, static_cast<float>(sine * world.x + cosine * world.z)};
}

void rotate_to_heading(std::span<float> coefficients, int order, double heading_rad) {
  EARSHOT_EXPECT(order >= 0 && coefficients.size() >= acn(order + 1, -order - 1));
  for (int m = 1; m <= order; ++m) {
    const double cosine = std::cos(m * heading_rad), sine = std::sin(m * heading_rad);
    for (int l = m; l <= order; ++l) {
      float& even = coefficients[acn(l, m)];
      float& odd = coefficients[acn(l, -m)];
      const double turned = cosine * even + sine * odd;
      odd = static_cast<float>(cosine * odd - sine * even);
      even = static_cast<float>(turned);
    }
  }
}

}  // namespace earshot
