// SPDX-License-Identifier: Apache-2.0
#include "sim/base/processor.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>

namespace earshot {
namespace {

TEST(Processor, RootsAreThoseOfTheLibraryToTheLastBit) {
  constexpr float infinity = std::numeric_limits<float>::infinity();
  std::uint32_t state = 1;
  for (int round = 0; round < 2000; ++round) {
    EightFloats values{0.f, -0.f, infinity, 1.f, 2.f, std::numeric_limits<float>::min(), std::numeric_limits<float>::denorm_min(), 1e38f};
    if (round > 0) {
      for (int lane = 0; lane < 8; ++lane) {
        state = state * 1664525u + 1013904223u;
        values[lane] = std::bit_cast<float>(state % 0x7F800000u);  // any finite number from 0 up
      }
    }
    EightFloats roots = values;
    take_roots(roots);
    for (int lane = 0; lane < 8; ++lane)
      ASSERT_EQ(std::bit_cast<std::uint32_t>(roots[lane]), std::bit_cast<std::uint32_t>(std::sqrt(values[lane]))) << values[lane];
  }
  EightFloats negative = EightFloats{} - 1.f;
  take_roots(negative);
  for (int lane = 0; lane < 8; ++lane) EXPECT_TRUE(std::isnan(negative[lane]));
}

TEST(Processor, TheBitsOfDenormalsAreSetAndCleared) {
  const FloatControl before = read_float_control();
  write_float_control(before | kFlushDenormals);
  EXPECT_EQ(read_float_control() & kFlushDenormals, kFlushDenormals);
  write_float_control(before);
  EXPECT_EQ(read_float_control(), before);
#if defined(__x86_64__) || defined(__aarch64__)
  EXPECT_NE(kFlushDenormals, 0u);
#endif
}

TEST(Processor, WhatRunsThisTestHasWhatItIsCompiledFor) {
  EXPECT_EQ(kUsedInstructionSets & ~present_instruction_sets(), 0u);
  char text[256];
  EXPECT_TRUE(has_used_instruction_sets(text));
}

TEST(Processor, ALongMessageEndsAtTheEndOfItsBuffer) {
  char text[256];
  std::size_t length = 0;
  for (int part = 0; part < 100; ++part) length = append_part(text, length, "AVX-512, ");
  EXPECT_EQ(length, 255u);
  EXPECT_EQ(std::string(text).size(), 255u);
  EXPECT_EQ(append_part(text, 0, "one"), 3u);
  EXPECT_STREQ(text, "one");
}

}  // namespace
}  // namespace earshot
