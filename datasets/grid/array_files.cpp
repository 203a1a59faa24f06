// SPDX-License-Identifier: Apache-2.0
#include "datasets/grid/array_files.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

namespace earshot {

std::string encode_npy(std::string_view type, std::span<const std::size_t> shape, std::string_view data) {
  constexpr std::size_t prefix_bytes = 10, alignment = 64;
  std::string sizes;
  for (const std::size_t size : shape) sizes += fmt::format("{}, ", size);
  std::string header = fmt::format("{{'descr': '{}', 'fortran_order': False, 'shape': ({}), }}", type, sizes);
  header.append(alignment - 1 - (prefix_bytes + header.size()) % alignment, ' ');
  header += '\n';
  std::string file("\x93NUMPY\x01\x00", 8);
  file += static_cast<char>(header.size() & 0xff);
  file += static_cast<char>(header.size() >> 8);
  file += header;
  file += data;
  return file;
}

nlohmann::ordered_json zarr_array(std::string_view type, std::span<const std::size_t> shape, std::span<const std::size_t> chunks) {
  return {{"zarr_format", 2},
          {"shape", std::vector<std::size_t>(shape.begin(), shape.end())},
          {"chunks", std::vector<std::size_t>(chunks.begin(), chunks.end())},
          {"dtype", type},
          {"compressor", nullptr},
          {"fill_value", 0},
          {"order", "C"},
          {"filters", nullptr}};
}

}  // namespace earshot
