// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/tracers/ray_population.h"

#include <cmath>

#include "sim/base/errors.h"

namespace earshot {

double effective_sample_size(std::span<const double> weights) {
  double sum = 0, squares = 0;
  for (const double weight : weights) {
    sum += weight;
    squares += weight * weight;
  }
  return squares > 0 ? sum * sum / squares : 0.0;
}

void systematic_resample(std::span<const double> weights, int target, double random, std::span<int> copies) {
  EARSHOT_EXPECT(weights.size() == copies.size());
  double sum = 0;
  for (const double weight : weights) sum += weight;
  // Ray i gets the integers that lie between its ends of the running total, shifted by one random number for all.
  const double scale = target / sum;
  double running = 0, previous_cumulative = std::floor(random);
  std::size_t last = 0;
  int given = 0;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    running += weights[i];
    const double cumulative = std::floor(running * scale + random);
    copies[i] = static_cast<int>(cumulative - previous_cumulative);
    given += copies[i];
    previous_cumulative = cumulative;
    if (weights[i] > 0) last = i;
  }
  // The end of the running total may be an ulp off `target`.
  copies[last] += target - given;
}

}  // namespace earshot
