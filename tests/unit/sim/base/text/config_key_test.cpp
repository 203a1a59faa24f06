// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/config_key.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <limits>

namespace earshot {
namespace {

TEST(ConfigKey, NumbersReadAsOneWritesThem) {
  EXPECT_EQ(number_text(0), "0");
  EXPECT_EQ(number_text(-1), "-1");
  EXPECT_EQ(number_text(999), "999");
  EXPECT_EQ(number_text(1000), "1,000");
  EXPECT_EQ(number_text(-100000), "-100,000");
  EXPECT_EQ(number_text(1 << 20), "1,048,576");
  EXPECT_EQ(number_text(0.05), "0.05");
  EXPECT_EQ(number_text(1e-5), "0.00001");
  EXPECT_EQ(number_text(static_cast<double>(std::numeric_limits<std::uint64_t>::max())), "2^64 - 1");
  EXPECT_EQ(number_text(static_cast<double>(std::numeric_limits<std::int64_t>::max())), "2^63 - 1");
}

TEST(ConfigKey, UnitsAreTheSuffixOfTheLastPart) {
  EXPECT_EQ(unit_of_key("env.acoustics.time_bin_s"), "s");
  EXPECT_EQ(unit_of_key("air.speed_of_sound_m_per_s"), "m/s");
  EXPECT_EQ(unit_of_key("air.temperature_c"), "degrees Celsius");
  EXPECT_EQ(unit_of_key("total_steps"), "steps");
  EXPECT_EQ(unit_of_key("map.metres_per_px"), "m");
  EXPECT_EQ(unit_of_key("rays"), "");
  EXPECT_EQ(unit_of_key("length_s.rays"), "");
}

TEST(ConfigKey, RangesAreWordsForTheReader) {
  const auto number = [](const Allowed& allowed) { return ConfigKey{.name = "x", .type = KeyType::number, .allowed = allowed}; };
  EXPECT_EQ(wanted_text(number(Allowed::between(0, 4))), "a number from 0 to 4");
  EXPECT_EQ(wanted_text(number(Allowed::above(0).below(1))), "a number above 0 and below 1");
  EXPECT_EQ(wanted_text(number(Allowed::at_least(0))), "a number of at least 0");
  EXPECT_EQ(wanted_text(number(Allowed::any().up_to(1))), "a number of at most 1");
  EXPECT_EQ(wanted_text(number(Allowed::any())), "a finite number");
  EXPECT_EQ(wanted_text(number(Allowed::between(1, 1000).or_value(0))), "a number from 1 to 1,000, or 0");
  EXPECT_EQ(allowed_text(number(Allowed::between(1, 1000).or_value(0))), "1 to 1,000, or 0");
  EXPECT_EQ(allowed_text(number(Allowed::at_least(0))), "at least 0");
  EXPECT_EQ(allowed_text(number(Allowed::any())), "");
  const ConfigKey width{.name = "width_px", .type = KeyType::whole_number, .allowed = Allowed::between(8, 4096).multiple_of(8)};
  EXPECT_EQ(wanted_text(width), "a multiple of 8 from 8 to 4,096 pixels");
  EXPECT_EQ(allowed_text(width), "8 to 4,096, a multiple of 8");
  const ConfigKey choice{.name = "x", .type = KeyType::choice, .choices = {"a", "b", "c"}};
  EXPECT_EQ(wanted_text(choice), "a, b or c");
  const ConfigKey size{.name = "size_m", .type = KeyType::numbers, .allowed = Allowed::between(1, 9).items(3)};
  EXPECT_EQ(wanted_text(size), "a list of 3 numbers from 1 to 9 m");
  EXPECT_EQ(allowed_text(size), "3 numbers, 1 to 9");
}

}  // namespace
}  // namespace earshot
