// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "sim/base/random.h"

namespace earshot {

/// Numbers that a test draws one after the other, the same every time.  seed: of the test file.  number: of the setting.
class Draws {
 public:
  Draws(std::uint64_t seed, std::uint32_t number) : random_(seed, Purpose::test, number) {}
  double within(double low, double high) { return low + (high - low) * static_cast<double>(random_.uniform(draw_++)); }

 private:
  RandomStream random_;
  std::uint32_t draw_ = 0;
};

}  // namespace earshot
