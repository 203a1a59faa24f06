// SPDX-License-Identifier: Apache-2.0
#include "sim/rays/embree_options.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "sim/base/errors.h"
#include "sim/rays/ray_tracer_version.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

/// Of a processor without AVX-512.
const std::vector<RayIsa> kIsas{{"sse2", true}, {"sse4.2", true}, {"avx", true}, {"avx2", true}, {"avx512", false}};

std::string refusal(const std::string& isa, const std::vector<RayIsa>& isas) {
  try {
    return "no refusal, but " + embree_options_of(isa, isas);
  } catch (const InputError& error) {
    return error.what();
  }
}

TEST(EmbreeOptions, NameWhatIsAskedForAndNothingWithoutAWish) {
  EXPECT_EQ(embree_options_of("", kIsas), "");
  EXPECT_EQ(embree_options_of("", {}), "");
  std::vector<RayIsa> all = kIsas;
  all.back().present = true;
  EXPECT_EQ(embree_options_of("avx512", all), "isa=avx512");
  for (const char* isa : {"sse2", "sse4.2", "avx", "avx2"}) EXPECT_EQ(embree_options_of(isa, kIsas), std::string("isa=") + isa);
}

TEST(EmbreeOptions, WithoutAWishAProcessorWithAvx512TracesAsOneWithAvx2) {
  std::vector<RayIsa> all = kIsas;
  all.back().present = true;
  EXPECT_EQ(embree_options_of("", all), "isa=avx2");
}

TEST(EmbreeOptions, UnknownNamesAreRefusedWithTheNearestAndAllKnownOnes) {
  EXPECT_THAT(refusal("avx3", kIsas),
              AllOf(HasSubstr("EARSHOT_ISA=avx3"), HasSubstr("did you mean 'avx"), HasSubstr("sse2, sse4.2, avx, avx2, avx512")));
  EXPECT_THAT(refusal("AVX2", kIsas), HasSubstr("unknown instruction set"));
  EXPECT_THAT(refusal("altivec7", kIsas), AllOf(Not(HasSubstr("did you mean")), HasSubstr("sse2, sse4.2, avx, avx2, avx512")));
  // What follows a comma would be another option of Embree's.
  EXPECT_THAT(refusal("avx2,threads=1", kIsas), HasSubstr("unknown instruction set"));
}

TEST(EmbreeOptions, WhatTheProcessorLacksIsRefusedWithWhatItHas) {
  EXPECT_THAT(refusal("avx512", kIsas),
              AllOf(HasSubstr("this processor does not support this instruction set"), HasSubstr("one of: sse2, sse4.2, avx, avx2; or")));
  EXPECT_THAT(refusal("avx2", {}), HasSubstr("only one instruction set"));
}

TEST(EmbreeOptions, SetInUseIsOneThatTheProcessorHas) {
  const std::string used = ray_tracer_isa();
  bool present = ray_isas().empty() && used == "neon";
  for (const RayIsa& isa : ray_isas()) present |= isa.name == used && isa.present;
  EXPECT_TRUE(present) << used;
}

}  // namespace
}  // namespace earshot
