// SPDX-License-Identifier: Apache-2.0
#include "policy/picture_patches.h"

#include <algorithm>

namespace earshot {
namespace {

/// N: floats of one row of a patch where the compiler knows it, so that short copies are a few instructions; 0: any.
template <std::int64_t N>
void copy_rows(const PatchShape& shape, const float* picture, float* patches) {
  const std::int64_t row = shape.kernel * shape.in_channels, length = N > 0 ? N : row;
  const std::int64_t line = shape.in_columns * shape.in_channels, step = shape.stride * shape.in_channels, size = shape.patch_size();
  const std::int64_t out_rows = shape.out_rows(), out_columns = shape.out_columns();
  for (std::int64_t y = 0; y < out_rows; ++y)
    for (std::int64_t ky = 0; ky < shape.kernel; ++ky) {
      const float* from = picture + (y * shape.stride + ky) * line;
      float* to = patches + y * out_columns * size + ky * row;
      for (std::int64_t x = 0; x < out_columns; ++x, from += step, to += size) std::copy_n(from, length, to);
    }
}

}  // namespace

void copy_patches(const PatchShape& shape, const float* picture, float* patches) {
  switch (shape.kernel * shape.in_channels) {
    case 8:
      return copy_rows<8>(shape, picture, patches);
    case 10:
      return copy_rows<10>(shape, picture, patches);
    case 16:
      return copy_rows<16>(shape, picture, patches);
    case 24:
      return copy_rows<24>(shape, picture, patches);
    case 48:
      return copy_rows<48>(shape, picture, patches);
    case 64:
      return copy_rows<64>(shape, picture, patches);
    default:
      return copy_rows<0>(shape, picture, patches);
  }
}

void add_patches(const PatchShape& shape, const float* patches, float* picture) {
  const std::int64_t row = shape.kernel * shape.in_channels, line = shape.in_columns * shape.in_channels;
  const std::int64_t step = shape.stride * shape.in_channels, size = shape.patch_size();
  const std::int64_t out_rows = shape.out_rows(), out_columns = shape.out_columns();
  for (std::int64_t y = 0; y < out_rows; ++y)
    for (std::int64_t ky = 0; ky < shape.kernel; ++ky) {
      float* to = picture + (y * shape.stride + ky) * line;
      const float* from = patches + y * out_columns * size + ky * row;
      for (std::int64_t x = 0; x < out_columns; ++x, from += size, to += step)
        for (std::int64_t i = 0; i < row; ++i) to[i] += from[i];
    }
}

}  // namespace earshot
