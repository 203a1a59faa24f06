// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/point_cloud/lzf.h"

namespace earshot {

std::optional<std::string> expand_lzf(std::string_view packed, std::size_t size) {
  constexpr std::size_t kMaxRatio = 88;  // three bytes stand for up to 264
  if (size / kMaxRatio > packed.size()) return std::nullopt;
  std::string out;
  out.reserve(size);
  std::size_t at = 0;
  const auto byte = [&] { return static_cast<std::size_t>(static_cast<unsigned char>(packed[at++])); };
  while (at < packed.size()) {
    const std::size_t control = byte();
    if (control < 32) {
      const std::size_t length = control + 1;
      if (length > packed.size() - at || length > size - out.size()) return std::nullopt;
      out.append(packed.substr(at, length));
      at += length;
      continue;
    }
    std::size_t length = control >> 5;
    if (length == 7) {
      if (at == packed.size()) return std::nullopt;
      length += byte();
    }
    if (at == packed.size()) return std::nullopt;
    const std::size_t distance = ((control & 31) << 8) + byte() + 1;
    length += 2;
    if (distance > out.size() || length > size - out.size()) return std::nullopt;
    for (std::size_t i = 0; i < length; ++i) out.push_back(out[out.size() - distance]);  // may overlap itself
  }
  if (out.size() != size) return std::nullopt;
  return out;
}

}  // namespace earshot
