// SPDX-License-Identifier: Apache-2.0
#include "envs/batch/batch_rows.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace earshot {
namespace {

constexpr int kBlockSamples = 2400;

/// Depth of the main camera, colours and depth of a further one, and a spectrogram.
ObservationSpec two_cameras() {
  ObservationSpec spec;
  spec.camera.width_px = spec.camera.height_px = 4;
  spec.cameras = {{.name = "side", .config = {.width_px = 3, .height_px = 2}, .depth = true, .rgb = true}};
  return spec;
}

TEST(BatchRows, EverySensorOfTheTableHasRowsByNameAndByKind) {
  const BatchRows rows(two_cameras(), kBlockSamples, 5);
  EXPECT_EQ(rows.table().size(), 4u);
  for (const SensorSpec& sensor : rows.table()) {
    EXPECT_EQ(rows.now(sensor.name).size(), 5 * sensor.bytes()) << sensor.name;
    EXPECT_EQ(rows.last(sensor.name).size(), 5 * sensor.bytes()) << sensor.name;
    SensorRows* const by_kind = rows.of(sensor.kind, sensor.camera);
    ASSERT_NE(by_kind, nullptr) << sensor.name;
    EXPECT_EQ(by_kind->now().data(), rows.now(sensor.name).data()) << sensor.name;
  }
  EXPECT_NE(rows.of(SensorKind::depth, 0), rows.of(SensorKind::depth, 1));
  EXPECT_EQ(rows.of(SensorKind::rgb, 0), nullptr);
  EXPECT_EQ(rows.of(SensorKind::pointgoal), nullptr);
  EXPECT_TRUE(rows.now("rgb").empty() && rows.last("rgb").empty() && rows.now("no such sensor").empty());
}

TEST(BatchRows, SoundIsKeptWhereASensorHears) {
  const BatchRows hearing(two_cameras(), kBlockSamples, 2);
  EXPECT_EQ(find_sensor(hearing.table(), "waveform"), nullptr);
  EXPECT_EQ(hearing.now("waveform").size(), 2 * 2 * kBlockSamples * sizeof(float));
  EXPECT_NE(hearing.of(SensorKind::heard), nullptr);
  ObservationSpec deaf = two_cameras();
  deaf.spectrogram = false;
  EXPECT_EQ(BatchRows(deaf, kBlockSamples, 2).of(SensorKind::heard), nullptr);
}

TEST(BatchRows, ACallThatNamesARowLeavesTheOthers) {
  BatchRows rows(two_cameras(), kBlockSamples, 3);
  SensorRows& depth = *rows.of(SensorKind::depth, 0);
  for (std::size_t row = 0; row < 3; ++row) std::ranges::fill(depth.row<float>(row), 1.f + static_cast<float>(row));
  rows.keep(1);
  rows.clear(1);
  const auto now = as_floats(rows.now("depth")), last = as_floats(rows.last("depth"));
  for (std::size_t i = 0; i < now.size(); ++i) {
    const std::size_t row = i / 16;
    EXPECT_EQ(now[i], row == 1 ? 0.f : 1.f + static_cast<float>(row));
    EXPECT_EQ(last[i], row == 1 ? 2.f : 0.f);
  }

  for (std::size_t row = 0; row < 3; ++row) rows.publish(row, {.reward = 2, .collided = true, .acted = true}, true);
  rows.give_up(0);
  rows.clear_outcome(2);
  EXPECT_EQ(std::vector<float>(rows.rewards().begin(), rows.rewards().end()), (std::vector<float>{0, 2, 0}));
  const auto flags = [](std::span<const std::uint8_t> values) { return std::vector<int>(values.begin(), values.end()); };
  EXPECT_EQ(flags(rows.quarantined()), (std::vector{1, 0, 0}));
  EXPECT_EQ(flags(rows.truncated()), (std::vector{1, 0, 0}));
  EXPECT_EQ(flags(rows.active()), (std::vector{0, 1, 1}));
  EXPECT_EQ(flags(rows.collided()), (std::vector{0, 1, 0}));
  EXPECT_EQ(flags(rows.acted()), (std::vector{0, 1, 0}));
  EXPECT_EQ(as_floats(rows.last("depth"))[0], 0.f);
}

}  // namespace
}  // namespace earshot
