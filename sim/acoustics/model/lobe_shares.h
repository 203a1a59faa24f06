// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>

namespace earshot {

/// Value of config.specular_exponent by which the exponent follows from the scattering coefficient, per material and band.
inline constexpr float kExponentFromScattering = -1.f;

/// Exponents of the lobes that all others are mixed from: 1, 2, 4, ... 1024.
inline constexpr std::size_t kLobeLadder = 11;
inline constexpr std::array<float, kLobeLadder> kLadderExponents = {1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024};

/// One lobe about the mirror direction in the place of a mirror and Lambert, for a scattering coefficient s: the width of the lobe says
/// how much a surface scatters, as in SoundSpaces 2.0 (Chen et al. 2022, supplement, which gives no formula).
///
/// Here the exponent is n = 3 / s - 3.  At normal incidence the mean cosine to the mirror direction is then that of a mirror and Lambert in
/// the shares 1 - s and s: (n + 2) / (n + 3) = 1 - s / 3.  A lobe of that exponent is a mixture of its two neighbours in the ladder, or
/// above s = 3/4, n = 1, of the widest lobe and Lambert, and below s = 3/1027 of the narrowest and a mirror, with the same mean cosine.  So
/// s = 1 is Lambert, s = 0 a mirror, and all between is continuous in s.  Every part keeps all energy and is reciprocal
/// (specular_lobe.h), hence the mixture too.
struct LobeShares {
  float diffuse = 0, mirror = 0;
  std::array<float, kLobeLadder> lobe{};  ///< together with the others: 1
};
/// s in [0, 1].
LobeShares shares_of_scattering(float s);

}  // namespace earshot
