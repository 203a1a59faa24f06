// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace earshot {

/// One convolution of pictures [in_rows, in_columns, in_channels] without padding.
struct PatchShape {
  std::int64_t in_rows = 0, in_columns = 0, in_channels = 0, kernel = 1, stride = 1;

  [[nodiscard]] std::int64_t out_rows() const { return (in_rows - kernel) / stride + 1; }
  [[nodiscard]] std::int64_t out_columns() const { return (in_columns - kernel) / stride + 1; }
  [[nodiscard]] std::int64_t num_patches() const { return out_rows() * out_columns(); }
  [[nodiscard]] std::int64_t patch_size() const { return kernel * kernel * in_channels; }
  [[nodiscard]] std::int64_t picture_size() const { return in_rows * in_columns * in_channels; }
};

/// patches [num_patches, patch_size]: receptive field of each output position, in the order [row, column, channel].
void copy_patches(const PatchShape& shape, const float* picture, float* patches);
/// The transpose: adds every patch to where it came from.  picture: [picture_size], added to.
void add_patches(const PatchShape& shape, const float* patches, float* picture);

}  // namespace earshot
