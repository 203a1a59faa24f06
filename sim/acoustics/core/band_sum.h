// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace earshot {

/// Adds the lanes as a tree: a running sum would cost W dependent additions.
template <int W>
float sum_over_bands(const float (&values)[W]) {
  float part[8];
  for (int b = 0; b < 8; ++b) part[b] = values[b];
  for (int block = 8; block < W; block += 8) {
    for (int b = 0; b < 8; ++b) part[b] += values[block + b];
  }
  for (int b = 0; b < 4; ++b) part[b] += part[b + 4];
  return (part[0] + part[2]) + (part[1] + part[3]);
}

}  // namespace earshot
