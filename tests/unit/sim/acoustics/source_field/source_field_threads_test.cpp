// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <vector>

#include "sim/acoustics/source_field/source_field.h"
#include "tests/support/acoustics/rooms.h"
#include "tests/support/acoustics/source_field_cases.h"

namespace earshot {
namespace {

using namespace source_fields;

TEST(SourceField, ThreadsAndRefinementSchedulesGiveTheSameBits) {
  const auto room = rooms::shoe1(0.2, 0.4);
  AcousticConfig config = field_config(8192, 1.f);
  const auto image_with = [&](int threads) {
    config.threads = threads;
    const Field field(room, config, rooms::shoe1_source());
    const auto image = field.field->image();
    return std::vector<std::byte>(image.begin(), image.end());
  };
  const auto one_thread = image_with(1);
  EXPECT_EQ(one_thread, image_with(2));

  config.threads = 1;
  const AcousticScene scene(room, config);
  const EarlyCandidates candidates(scene, rooms::shoe1_source());
  SourceFieldBuilder builder(scene, candidates);
  while (builder.refine()) (void)builder.snapshot();  // looking on the way changes nothing
  const auto snapshot = builder.snapshot();
  const auto last = snapshot->image();
  EXPECT_TRUE(std::equal(one_thread.begin(), one_thread.end(), last.begin(), last.end()));
}

}  // namespace
}  // namespace earshot
