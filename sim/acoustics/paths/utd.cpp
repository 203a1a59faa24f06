// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/utd.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/acoustics/paths/fast_angles.h"

namespace earshot {
ComplexLanes scaled_erfc(const Lanes& u) {
  // Fitted with least relative error to the exact values at 2,000 points of [0, infinity); no coefficient is negative, so that nothing
  // cancels.
  const Lanes real_above =
      0.99999928f + u * (0.707220827f + u * (0.463605598f + u * (0.267647042f + u * (0.0689057403f + u * 0.0354334314f))));
  const Lanes real_below =
      1.f + u * (1.50503925f + u * (1.6654277f + u * (1.05918756f + u * (0.6274129f + u * (0.172701619f + u * 0.0888185076f)))));
  const Lanes imag_above = 0.797882202f + u * (0.583345185f + u * (0.36825995f + u * (0.126322755f + u * 0.0631660339f)));
  const Lanes imag_below =
      1.f + u * (1.98414908f + u * (2.28591422f + u * (1.67531874f + u * (0.998168323f + u * (0.316755242f + u * 0.158333282f)))));
  return {real_above / real_below, -u * (imag_above / imag_below)};
}

WedgeDiffraction::WedgeDiffraction(double exterior_rad, double source_rad, double listener_rad) {
  const double n = exterior_rad / std::numbers::pi;
  const double difference = std::abs(source_rad - listener_rad), sum = source_rad + listener_rad;
  // pi -+ (phi - phi'), pi -+ (phi + phi'), each less the multiple of 2 pi n that brings it nearest to zero: N+ and N- of the paper.
  FourNumbers from_boundary = {std::numbers::pi - difference, std::numbers::pi + difference, std::numbers::pi - sum,
                               std::numbers::pi + sum},
              half;
  const double turn = 2.0 * exterior_rad;
  for (std::size_t i = 0; i < 4; ++i) {
    from_boundary[i] -= turn * std::nearbyint(from_boundary[i] / turn);
    half[i] = 0.5 * std::abs(from_boundary[i]);
  }
  // sin(half) / tan(half / n), 0 <= half / n <= pi / 2.
  const FourPhases whole = fast_unit_phase(half), part = fast_unit_phase(half / n);
  for (std::size_t i = 0; i < 4; ++i) {
    from_boundary_[i] = from_boundary[i];
    boundary_[i] = std::abs(whole.sine[i]);
    const double slope = half[i] > 1e-9 ? boundary_[i] * part.cosine[i] / part.sine[i] : n;
    weight_[i] = (from_boundary[i] < 0 ? 0.5 : -0.5) * slope / n;
  }
}

ComplexLanes WedgeDiffraction::ratio(const Lanes& root_of_two_wave_lengths, const FaceFactorLanes& faces) const {
  const std::array<const Lanes*, 4> face = {&faces.incidence, &faces.incidence, &faces.first, &faces.second};
  ComplexLanes sum;
  for (std::size_t i = 0; i < 4; ++i) {
    const Lanes weight = static_cast<float>(weight_[i]) * *face[i];
    sum = sum + weight * scaled_erfc(root_of_two_wave_lengths * static_cast<float>(boundary_[i]));
  }
  return sum;
}

double kurze_anderson_db(double fresnel_number) {
  const double root = std::sqrt(2.0 * std::numbers::pi * std::max(fresnel_number, 0.0));
  return 5.0 + (root > 1e-6 ? 20.0 * std::log10(root / std::tanh(root)) : 0.0);
}

}  // namespace earshot
