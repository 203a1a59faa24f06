// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace earshot {

/// Heap memory of a container, without the overhead of the allocator (about 16 bytes per block).
template <class T>
[[nodiscard]] std::size_t bytes_of(const std::vector<T>& values) {
  return values.capacity() * sizeof(T);
}
[[nodiscard]] inline std::size_t bytes_of(const std::string& text) {
  return text.capacity() < sizeof(std::string) / 2 ? 0 : text.capacity() + 1;  // short ones lie in the string itself
}
[[nodiscard]] inline std::size_t bytes_of(const std::vector<std::string>& texts) {
  std::size_t sum = texts.capacity() * sizeof(std::string);
  for (const std::string& text : texts) sum += bytes_of(text);
  return sum;
}

}  // namespace earshot
