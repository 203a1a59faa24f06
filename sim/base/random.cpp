// SPDX-License-Identifier: Apache-2.0
#include "sim/base/random.h"

#include <cmath>
#include <numbers>

namespace earshot {

std::array<std::uint32_t, 4> philox4x32(std::array<std::uint32_t, 4> counter, std::array<std::uint32_t, 2> key) {
  constexpr std::uint64_t multiplier0 = 0xD2511F53, multiplier1 = 0xCD9E8D57;
  constexpr std::uint32_t weyl0 = 0x9E3779B9, weyl1 = 0xBB67AE85;
  for (int round = 0; round < 10; ++round) {
    const std::uint64_t product0 = multiplier0 * counter[0];
    const std::uint64_t product1 = multiplier1 * counter[2];
    counter = {static_cast<std::uint32_t>(product1 >> 32) ^ counter[1] ^ key[0], static_cast<std::uint32_t>(product1),
               static_cast<std::uint32_t>(product0 >> 32) ^ counter[3] ^ key[1], static_cast<std::uint32_t>(product0)};
    key[0] += weyl0;
    key[1] += weyl1;
  }
  return counter;
}

RandomStream::RandomStream(std::uint64_t seed, Purpose purpose, std::uint32_t a, std::uint32_t b, std::uint32_t c) : a_(a), b_(b), c_(c) {
  // Seed and purpose are mixed by one Philox call: seeds that differ in one bit, or purposes that differ by one, give
  // unrelated keys.
  const auto mixed = philox4x32({static_cast<std::uint32_t>(purpose), 0x65617273u, 0x686F74u, 0},
                                {static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32)});
  key_ = {mixed[0], mixed[1]};
}

std::array<float, 2> RandomStream::uniform2(std::uint32_t draw) const {
  const auto words = bits4(draw);
  return {to_unit(words[0]), to_unit(words[1])};
}

std::array<float, 4> RandomStream::uniform4(std::uint32_t draw) const {
  const auto words = bits4(draw);
  return {to_unit(words[0]), to_unit(words[1]), to_unit(words[2]), to_unit(words[3])};
}

std::uint32_t RandomStream::below(std::uint32_t count, std::uint32_t draw) const {
  return static_cast<std::uint32_t>((static_cast<std::uint64_t>(bits4(draw)[0]) * count) >> 32);
}

std::array<float, 2> RandomStream::normal2(std::uint32_t draw) const {
  const auto words = bits4(draw);
  // (0, 1]: the logarithm of zero never happens.
  const double radius = std::sqrt(-2.0 * std::log((static_cast<double>(words[0]) + 1.0) / 4294967296.0));
  const double angle = 2.0 * std::numbers::pi * static_cast<double>(words[1]) / 4294967296.0;
  return {static_cast<float>(radius * std::cos(angle)), static_cast<float>(radius * std::sin(angle))};
}

}  // namespace earshot
