// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/lobe_shares.h"

#include <algorithm>

namespace earshot {

LobeShares shares_of_scattering(float s) {
  // What the mean cosine lacks to 1, at normal incidence: of Lambert, of a lobe, of a mirror.
  constexpr float of_lambert = 1.f / 3.f;
  const auto of_lobe = [](std::size_t i) { return 1.f / (kLadderExponents[i] + 3.f); };
  const float lacking = std::clamp(s, 0.f, 1.f) / 3.f;
  // Fraction of the first of two parts that lack `first` > `second`.
  const auto fraction = [&](float first, float second) { return std::clamp((lacking - second) / (first - second), 0.f, 1.f); };
  LobeShares shares;
  if (lacking >= of_lobe(0)) {
    shares.diffuse = fraction(of_lambert, of_lobe(0));
    shares.lobe[0] = 1.f - shares.diffuse;
    return shares;
  }
  for (std::size_t i = 1; i < kLobeLadder; ++i) {
    if (lacking < of_lobe(i)) continue;
    shares.lobe[i - 1] = fraction(of_lobe(i - 1), of_lobe(i));
    shares.lobe[i] = 1.f - shares.lobe[i - 1];
    return shares;
  }
  shares.lobe[kLobeLadder - 1] = fraction(of_lobe(kLobeLadder - 1), 0.f);
  shares.mirror = 1.f - shares.lobe[kLobeLadder - 1];
  return shares;
}

}  // namespace earshot
