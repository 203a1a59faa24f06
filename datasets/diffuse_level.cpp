// SPDX-License-Identifier: Apache-2.0
#include "datasets/diffuse_level.h"

#include <cmath>
#include <optional>

namespace earshot {

float diffuse_level(const ListenerLayout& layout, std::size_t channel) {
  if (layout.kind == ListenerKind::array) {
    const std::optional<float> omni_weight = layout.microphones[channel].omni_weight();
    return omni_weight ? std::sqrt(*omni_weight * *omni_weight + (1 - *omni_weight) * (1 - *omni_weight) / 3) : 1.f;
  }
  if (layout.kind != ListenerKind::ambisonics || layout.norm == HarmonicNorm::n3d) return 1.f;
  const double degree = std::floor(std::sqrt(static_cast<double>(channel)));
  return static_cast<float>(1 / std::sqrt(2 * degree + 1));
}

}  // namespace earshot
