// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/scaling_study.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <cstring>
#include <memory>

namespace earshot {
namespace {

// The address sanitizer does, to find who uses it.
#if defined(__has_feature)
#if __has_feature(address_sanitizer)
constexpr bool kKeepsWhatIsFreed = true;
#else
constexpr bool kKeepsWhatIsFreed = false;
#endif
#else
constexpr bool kKeepsWhatIsFreed = false;
#endif

// 64 MB that are written to are resident, and given back once they are freed.
TEST(ResidentBytes, GrowByWhatIsWritten) {
  constexpr std::size_t size = std::size_t{64} << 20;
  const double before = resident_bytes();
  auto block = std::make_unique<char[]>(size);
  std::memset(block.get(), 1, size);
  EXPECT_NE(block[size / 2], 0);
  const double with = resident_bytes();
  block.reset();
  // The kernel counts in batches, and may take back pages of others.
  EXPECT_NEAR(with - before, static_cast<double>(size), 0.25 * size);
  if (!kKeepsWhatIsFreed) {
    EXPECT_NEAR(resident_bytes() - before, 0, 0.25 * size);
  }
}

TEST(ScalingStudy, TablesHaveTheirRows) {
  ScalingStudy study;
  EXPECT_EQ(scaling_markdown(study), "");
  study.scenes = {
      {.spec = "house:7", .triangles = 5808, .load_ms = 12, .prepare_ms = 34, .memory_mb = 56, .per_source_ms = 7, .per_rir_ms = 0.5}};
  study.sources_spec = "house:8";
  study.sources = {{.sources = 4, .per_source_ms = 7, .per_response_ms = 2}};
  EXPECT_THAT(scaling_markdown(study), testing::HasSubstr("| `house:7` | 5808 | 12 | 34 | 56 | 7 | 0.5 |"));
  EXPECT_THAT(scaling_markdown(study), testing::HasSubstr("| 4 | 7 | 2 |"));
}

}  // namespace
}  // namespace earshot
