// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/core/arrival.h"

#include "sim/base/files.h"

namespace earshot {

std::uint64_t path_identity(ArrivalKind kind, std::span<const std::uint32_t> met) {
  const bool straight = kind == ArrivalKind::direct || kind == ArrivalKind::transmission;
  const std::uint64_t identity = hash64(std::as_bytes(straight ? std::span<const std::uint32_t>() : met),
                                        static_cast<std::uint64_t>(straight ? ArrivalKind::direct : kind) + 1);
  return identity != 0 ? identity : 1;
}

}  // namespace earshot
