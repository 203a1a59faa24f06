// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <thread>
#include <vector>

#include "sim/acoustics/source_field/refining_field.h"
#include "sim/scene/scene.h"

namespace earshot {
namespace {

AcousticConfig refining_config() {
  AcousticConfig config;
  config.early_candidate_rays = 100;
  config.rir_length_s = 0.2f;
  config.field_photons = 8192;
  config.field_error = 1e-6f;  // never met: all photons are spent
  return config;
}

class RefiningFieldTest : public testing::Test {
 protected:
  const AcousticScene room_{std::make_shared<const Scene>(load_scene("shoebox:6x3x4@0.3")), refining_config()};
  const EarlyCandidates source_{room_, glm::vec3{1.5f, 1.4f, 1.1f}};
};

bool same_image(const SourceField& a, const SourceField& b) { return std::ranges::equal(a.image(), b.image()); }

TEST_F(RefiningFieldTest, SnapshotsAreThoseOfTheBuilderWhateverTheTiming) {
  std::vector<std::shared_ptr<const SourceField>> expected;
  SourceFieldBuilder builder(room_, source_);
  while (builder.refine()) expected.push_back(builder.snapshot());
  ASSERT_GE(expected.size(), 3u);
  EXPECT_LT(expected.front()->photons(), expected.back()->photons());
  for (const int wait_ms : {0, 5, 50}) {
    RefiningField field(room_, source_);
    for (std::size_t n = 0; n < expected.size(); ++n) {
      std::this_thread::sleep_for(std::chrono::milliseconds(wait_ms));  // behind it, or level with it
      EXPECT_TRUE(same_image(*field.wait_for(static_cast<int>(n)), *expected[n])) << n;
    }
    EXPECT_TRUE(same_image(*field.wait_for(1000), *expected.back()));  // the target was met before
    EXPECT_TRUE(same_image(*field.wait_for_target(), *build_source_field(room_, source_)));
    EXPECT_TRUE(field.finished());
    EXPECT_EQ(field.num_snapshots(), static_cast<int>(expected.size()));
    EXPECT_EQ(field.latest(), field.wait_for_target());
  }
}

TEST_F(RefiningFieldTest, SnapshotsMayBeSkippedAndOldOnesStayWithTheirHolder) {
  RefiningField field(room_, source_);
  const auto first = field.wait_for(0);
  const std::vector<std::byte> bytes(first->image().begin(), first->image().end());
  const auto third = field.wait_for(2);
  EXPECT_LT(first->photons(), third->photons());
  field.wait_for_target();
  EXPECT_TRUE(std::ranges::equal(first->image(), bytes));
}

TEST_F(RefiningFieldTest, SeveralThreadsMayWait) {
  RefiningField field(room_, source_);
  std::vector<std::shared_ptr<const SourceField>> got(4);
  {
    std::vector<std::jthread> threads;
    for (auto& mine : got) threads.emplace_back([&] { mine = field.wait_for(1); });
  }
  for (const auto& mine : got) EXPECT_EQ(mine, got[0]);
}

TEST_F(RefiningFieldTest, GoesAwayWhileItRefines) {
  for (int i = 0; i < 5; ++i) {
    const RefiningField field(room_, source_);
    EXPECT_GE(field.num_snapshots(), 0);
  }
}

}  // namespace
}  // namespace earshot
