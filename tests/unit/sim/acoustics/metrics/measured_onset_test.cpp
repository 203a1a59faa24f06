// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <vector>

#include "sim/acoustics/metrics/onset.h"
#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/audio/dry_sounds/sound_clip.h"
#include "tests/support/files/test_data.h"

namespace earshot {
namespace {

// Measured responses whose index states the onset, to 0.1 ms, and the direct-to-reverberant ratio around the strongest early sample.  Where
// that sample follows the onset within 1 ms both ratios mean the same direct sound: 0.5 dB for the windows.  The index takes files of
// several channels together.
TEST(MeasuredOnset, AgreesWithTheIndexOfMeasuredResponses) {
  SKIP_WITHOUT_DATA("rir_measured/index.json");
  std::ifstream file(data_folder() / "rir_measured" / "index.json");
  int mono = 0, strong = 0, all = 0;
  for (const nlohmann::json& row : nlohmann::json::parse(file)) {
    const std::string name = row.at("file");
    ++all;
    const SoundChannels sound = load_sound_channels(data_folder() / "rir_measured" / name);
    const auto onset = find_onset(sound.channel(0), static_cast<double>(sound.sample_rate_hz));
    ASSERT_TRUE(onset.has_value()) << name;
    if (sound.num_channels > 1) continue;
    ++mono;
    EXPECT_NEAR(static_cast<double>(*onset) / static_cast<double>(sound.sample_rate_hz), row.at("onset_s").get<double>(), 1e-4) << name;
    if (row.at("onset_to_peak_ms").get<double>() > 1) continue;
    ++strong;
    const RoomMetrics metrics = measure(sound.channel(0), sound.sample_rate_hz, RirMeasurement{.is_green = true});
    ASSERT_TRUE(metrics.drr_db && metrics.direct_delay_s) << name;
    for (const BandMetrics& band : metrics.bands)
      for (const auto& value : {band.edt_s, band.t20_s, band.c80_db, band.ts_s, band.drr_db, band.g_db})
        if (value) {
          EXPECT_TRUE(std::isfinite(*value)) << name;
        }
    EXPECT_NEAR(*metrics.drr_db, row.at("DRR_db").get<double>(), 0.5) << name;
  }
  EXPECT_EQ(all, 51);
  EXPECT_GE(mono, 25);
  EXPECT_GE(strong, 10);
}

}  // namespace
}  // namespace earshot
