// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <string>

#include "sim/base/random.h"

namespace earshot {

/// A damaged copy: one to eight of bits flipped, bytes replaced, a piece removed, doubled or overwritten by another, the end cut off.
/// within: only the first bytes are damaged (0: all).  The same number gives the same damage.
inline std::string mutated(std::string bytes, std::uint32_t number, std::size_t within = 0) {
  const RandomStream random(20240611, Purpose::test, number);
  std::uint32_t draw = 0;
  const auto below = [&](std::size_t count) {
    return static_cast<std::size_t>(random.below(static_cast<std::uint32_t>(std::max<std::size_t>(count, 1)), draw++));
  };
  const std::size_t num_damages = 1 + below(8);
  for (std::size_t i = 0; i < num_damages && !bytes.empty(); ++i) {
    const std::size_t at = below(within ? std::min(within, bytes.size()) : bytes.size());
    const std::size_t length = std::min(1 + below(i % 2 ? 4 : 64), bytes.size() - at);
    switch (below(16)) {
      case 0:
        bytes.erase(at, length);
        break;
      case 1:
        bytes.insert(at, bytes.substr(at, length));
        break;
      case 2:
        bytes.replace(at, length, bytes.substr(below(bytes.size()), length));
        break;
      case 3:
        bytes.resize(std::max<std::size_t>(1, bytes.size() - below(bytes.size() / 2)));
        break;
      case 4:
      case 5:
      case 6:
        bytes[at] = static_cast<char>(below(256));
        break;
      case 7:
        bytes[at] = "09-.eE/ \n\r\xFF\x7F"[below(12)];
        break;
      default:
        bytes[at] = static_cast<char>(bytes[at] ^ (1 << below(8)));
        break;
    }
  }
  return bytes;
}

}  // namespace earshot
