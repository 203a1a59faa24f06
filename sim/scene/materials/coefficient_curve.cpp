// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "sim/base/errors.h"
#include "sim/scene/materials/materials.h"

namespace earshot {

CoefficientCurve CoefficientCurve::constant(float value) { return {{1000.f}, {value}}; }

float CoefficientCurve::at(float frequency_hz) const {
  EARSHOT_EXPECT(hz.size() == value.size());
  if (hz.empty()) return 0;
  const auto above = static_cast<std::size_t>(std::upper_bound(hz.begin(), hz.end(), frequency_hz) - hz.begin());
  if (above == 0) return value.front();
  if (above == hz.size()) return value.back();
  const double lower = std::log(static_cast<double>(hz[above - 1])), upper = std::log(static_cast<double>(hz[above]));
  const double weight = (std::log(static_cast<double>(frequency_hz)) - lower) / (upper - lower);
  return static_cast<float>(value[above - 1] + weight * (value[above] - value[above - 1]));
}

float CoefficientCurve::band_mean(float lower_hz, float upper_hz) const {
  EARSHOT_EXPECT(lower_hz > 0 && upper_hz >= lower_hz);
  if (!(upper_hz > lower_hz)) return at(lower_hz);
  // Between neighbouring knots the curve is a line in log f, so the trapezoid is exact there.
  double integral = 0, left_log = std::log(static_cast<double>(lower_hz)), left_value = at(lower_hz);
  const auto advance_to = [&](float right_hz) {
    const double right_log = std::log(static_cast<double>(right_hz)), right_value = at(right_hz);
    integral += 0.5 * (left_value + right_value) * (right_log - left_log);
    left_log = right_log;
    left_value = right_value;
  };
  for (const float knot_hz : hz) {
    if (knot_hz > lower_hz && knot_hz < upper_hz) advance_to(knot_hz);
  }
  advance_to(upper_hz);
  return static_cast<float>(integral / (std::log(static_cast<double>(upper_hz)) - std::log(static_cast<double>(lower_hz))));
}

Material Material::uniform(std::string name, float absorption, float scattering, float transmission) {
  Material material;
  material.name = std::move(name);
  material.absorption = CoefficientCurve::constant(absorption);
  material.scattering = CoefficientCurve::constant(scattering);
  material.transmission = CoefficientCurve::constant(transmission);
  material.damping_db_per_m = CoefficientCurve::constant(0);
  return material;
}

}  // namespace earshot
