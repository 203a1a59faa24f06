// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <limits>
#include <span>
#include <vector>

#include "trainer/collective/collective.h"

namespace earshot {

/// Addends of mixed sign and size, so that another order of summation gives other bits.
template <class T>
T addend(int rank, std::size_t i) {
  std::uint64_t bits = (i + 1) * 0x9E3779B97F4A7C15ull + static_cast<std::uint64_t>(rank + 1) * 0xD1B54A32D192ED03ull;
  bits = (bits ^ bits >> 29) * 0xBF58476D1CE4E5B9ull;
  const double unit = static_cast<double>(bits >> 11) / 9007199254740992.0 - 0.5;
  return static_cast<T>(std::ldexp(unit, static_cast<int>(bits % 9) - 4));
}

/// The stated order, written down a second time: rank order below 64 KiB, else segment k of the ring starts at rank k; segments are cut at
/// n k / P, rounded down to 16 elements.
inline int first_rank(std::size_t i, std::size_t count, std::size_t element_bytes, int world_size) {
  if (count * element_bytes < 65536) return 0;
  int segment = 0;
  while (segment + 1 < world_size && i >= count * static_cast<std::size_t>(segment + 1) / static_cast<std::size_t>(world_size) / 16 * 16)
    ++segment;
  return segment;
}

/// All addends of one rank.
template <class T>
std::vector<T> addends(int rank, std::size_t count) {
  std::vector<T> values(count);
  for (std::size_t i = 0; i < count; ++i) values[i] = addend<T>(rank, i);
  return values;
}

/// Added one after the other in that order.
template <class T>
std::vector<T> serial_sums(std::size_t count, int world_size) {
  std::vector<T> sums(count);
  for (std::size_t i = 0; i < count; ++i) {
    const int first = first_rank(i, count, sizeof(T), world_size);
    sums[i] = addend<T>(first, i);
    for (int k = 1; k < world_size; ++k) sums[i] += addend<T>((first + k) % world_size, i);
  }
  return sums;
}

/// Whether each element of a sum has the bits of the stated order, and the value of the exact sum within rounding.
template <class T>
bool sums_are_right(Collective& ring, std::size_t count) {
  const auto [rank, world_size] = ring.identity();
  std::vector<T> buffer(count);
  for (std::size_t i = 0; i < count; ++i) buffer[i] = addend<T>(rank, i);
  ring.all_reduce_sum(std::span<T>(buffer));
  for (std::size_t i = 0; i < count; ++i) {
    const int first = first_rank(i, count, sizeof(T), world_size);
    T ordered = addend<T>(first, i);
    double exact = ordered, magnitude = std::abs(exact);
    for (int k = 1; k < world_size; ++k) {
      const T next = addend<T>((first + k) % world_size, i);
      ordered += next;
      exact += next;
      magnitude += std::abs(static_cast<double>(next));
    }
    // Each of P - 1 additions rounds by half a unit in the last place of at most the sum of magnitudes.
    const double tolerance = world_size * static_cast<double>(std::numeric_limits<T>::epsilon()) * magnitude;
    if (std::memcmp(&ordered, &buffer[i], sizeof(T)) != 0 || std::abs(static_cast<double>(buffer[i]) - exact) > tolerance) {
      std::fprintf(stderr, "element %zu of %zu: %.17g, expected %.17g\n", i, count, static_cast<double>(buffer[i]), exact);
      return false;
    }
  }
  return true;
}

}  // namespace earshot
