// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/loudspeaker_layout.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <numbers>

#include "sim/base/errors.h"

namespace earshot {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

struct ExpectedChannel {
  const char* name;
  double azimuth_deg, omni_weight, right_m;
};

void expect_channels(const char* name, const std::vector<ExpectedChannel>& expected, std::uint32_t mask) {
  const ListenerLayout layout = ListenerLayout::named(name);
  ASSERT_EQ(layout.microphones.size(), expected.size()) << name;
  EXPECT_EQ(layout.channel_mask, mask) << name;
  for (std::size_t i = 0; i < expected.size(); ++i) {
    const Microphone& microphone = layout.microphones[i];
    EXPECT_EQ(microphone.name, expected[i].name) << name;
    EXPECT_EQ(layout.channel_names()[i], expected[i].name);
    const double angle = expected[i].azimuth_deg * std::numbers::pi / 180;
    const glm::vec3 front = microphone.orientation * glm::vec3(0, 0, -1);
    EXPECT_NEAR(front.x, -std::sin(angle), 1e-6) << name << " " << i;  // positive angles are to the left
    EXPECT_NEAR(front.y, 0, 1e-6);
    EXPECT_NEAR(front.z, -std::cos(angle), 1e-6);
    EXPECT_EQ(microphone.position_m, glm::vec3(static_cast<float>(expected[i].right_m), 0, 0));
    EXPECT_EQ(microphone.lowpass_hz, microphone.name == "lfe" ? 120.f : 0.f);
    EXPECT_NEAR(microphone.omni_weight().value(), expected[i].omni_weight, 1e-7);
  }
}

TEST(LoudspeakerLayout, HasTheChannelsOfItsLoudspeakersInTheOrderOfWavFiles) {
  for (const char* name : {"stereo", "stereo:xy"}) expect_channels(name, {{"left", 45, 0.5, 0}, {"right", -45, 0.5, 0}}, 0);
  expect_channels("stereo:ms", {{"mid", 0, 0.5, 0}, {"side", 90, 0, 0}}, 0);
  expect_channels("stereo:ab", {{"left", 0, 1, -0.25}, {"right", 0, 1, 0.25}}, 0);
  expect_channels("stereo:ortf", {{"left", 55, 0.5, -0.085}, {"right", -55, 0.5, 0.085}}, 0);
  expect_channels("quad", {{"left", 30, 0.5, 0}, {"right", -30, 0.5, 0}, {"rear_left", 95, 0.5, 0}, {"rear_right", -95, 0.5, 0}}, 0x33);
  const std::vector<ExpectedChannel> front{{"left", 30, 0.5, 0}, {"right", -30, 0.5, 0}, {"centre", 0, 0.5, 0}, {"lfe", 0, 1, 0}};
  std::vector<ExpectedChannel> expected = front;
  expected.insert(expected.end(), {{"surround_left", 110, 0.5, 0}, {"surround_right", -110, 0.5, 0}});
  expect_channels("surround_5_1", expected, 0x60F);
  expected = front;
  expected.insert(expected.end(),
                  {{"rear_left", 135, 0.5, 0}, {"rear_right", -135, 0.5, 0}, {"side_left", 90, 0.5, 0}, {"side_right", -90, 0.5, 0}});
  expect_channels("surround_7_1", expected, 0x63F);
}

TEST(LoudspeakerLayout, IsCoincidentUnlessItIsAPairApart) {
  for (const char* name : {"stereo", "stereo:xy", "stereo:ms", "quad", "surround_5_1", "surround_7_1", "mono:cardioid"})
    EXPECT_TRUE(ListenerLayout::named(name).is_coincident()) << name;
  for (const char* name : {"stereo:ab", "stereo:ortf", "mono:voice", "mono", "binaural", "ambisonic:1"})
    EXPECT_FALSE(ListenerLayout::named(name).is_coincident()) << name;
}

TEST(LoudspeakerLayout, ItsMaskIsFoundByItsNames) {
  for (const char* name : {"mono", "stereo", "binaural", "quad", "surround_5_1", "surround_7_1", "ambisonic:1"}) {
    const ListenerLayout layout = ListenerLayout::named(name);
    EXPECT_EQ(channel_mask_of(layout.channel_names()), layout.channel_mask) << name;
    EXPECT_EQ(std::popcount(layout.channel_mask), layout.channel_mask == 0 ? 0 : layout.num_channels()) << name;
  }
}

TEST(LoudspeakerLayout, OthersAreRefusedWithTheList) {
  for (const char* name : {"surround", "surround_5_2", "stereo:blumlein", "quad:1", "5.1", "Quad"}) {
    try {
      ListenerLayout::named(name);
      ADD_FAILURE() << "accepted " << name;
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr("'" + std::string(name) + "': is not a known layout"));
      EXPECT_THAT(error.what(), HasSubstr("stereo[:xy|:ms|:ab|:ortf], binaural, quad, surround_5_1, surround_7_1"));
    }
  }
}

}  // namespace
}  // namespace earshot
