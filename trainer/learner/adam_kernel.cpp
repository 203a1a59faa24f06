// SPDX-License-Identifier: Apache-2.0
#include "trainer/learner/adam_kernel.h"

#include <cmath>

#include "sim/base/errors.h"

namespace earshot {

void adam_step(const AdamRates& rates, std::int64_t step, double scale, std::span<const float> gradients, std::span<float> first_moments,
               std::span<float> second_moments, std::span<float> weights) {
  EARSHOT_EXPECT(step >= 1 && first_moments.size() == gradients.size() && second_moments.size() == gradients.size());
  EARSHOT_EXPECT(weights.size() == gradients.size());
  const double correction1 = 1 - std::pow(rates.beta1, static_cast<double>(step));
  const double correction2 = 1 - std::pow(rates.beta2, static_cast<double>(step));
  const float keep1 = static_cast<float>(rates.beta1), take1 = static_cast<float>(1 - rates.beta1);
  const float keep2 = static_cast<float>(rates.beta2), take2 = static_cast<float>(1 - rates.beta2);
  const float step_size = static_cast<float>(rates.learning_rate / correction1), epsilon = static_cast<float>(rates.epsilon);
  const float unbiased = static_cast<float>(1 / std::sqrt(correction2));
  const float* g = gradients.data();
  float *m = first_moments.data(), *v = second_moments.data(), *w = weights.data();
  for (std::size_t i = 0; i < gradients.size(); ++i) {
    // In double: a gradient of 1e38 and the scale that clips it are both finite, and so is their product.
    const float gradient = static_cast<float>(g[i] * scale);
    m[i] = keep1 * m[i] + take1 * gradient;
    v[i] = keep2 * v[i] + take2 * gradient * gradient;
    w[i] -= step_size * m[i] / (std::sqrt(v[i]) * unbiased + epsilon);
  }
}

}  // namespace earshot
