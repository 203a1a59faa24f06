// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/listener_layout.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "sim/audio/head/layout_file.h"
#include "sim/base/errors.h"
#include "tests/support/error_message.h"

namespace earshot {
namespace {

TEST(ListenerLayout, HasItsNames) {
  EXPECT_EQ(ListenerLayout::named("mono").num_channels(), 1);
  EXPECT_EQ(ListenerLayout::named("binaural").num_channels(), 2);
  const ListenerLayout ambisonics = ListenerLayout::named("ambisonics:3:sn3d:ego");
  EXPECT_EQ(ambisonics.num_channels(), 16);
  EXPECT_EQ(ambisonics.norm, HarmonicNorm::sn3d);
  EXPECT_EQ(ambisonics.axes, HarmonicAxes::ego);
  EXPECT_EQ(ListenerLayout::named("ambisonics:9").num_channels(), 100);
  EXPECT_EQ(ListenerLayout::named("ambisonics:0").num_channels(), 1);
  EXPECT_EQ(ListenerLayout::named("ambisonics:1").channel_names(), (std::vector<std::string>{"acn0", "acn1", "acn2", "acn3"}));
  EXPECT_EQ(ListenerLayout::named("mono:cardioid").kind, ListenerKind::array);
  EXPECT_EQ(ListenerLayout::named("mono:omni").kind, ListenerKind::mono);
  for (const char* wrong : {"stereophonic", "ambisonics", "ambisonics:", "ambisonics:10", "ambisonics:-1", "ambisonics:2x",
                            "ambisonics:2:maxn", "ambisonics:2:", "binaural:3", "array:", "mono:loud", "array:/nowhere/mics.yaml", ""})
    EXPECT_THROW(ListenerLayout::named(wrong), InputError) << wrong;
}

TEST(ListenerLayout, ATrailingColonIsRefused) {
  for (const std::string name : {"binaural", "mono", "stereo", "stereo:ab", "quad", "surround_5_1", "ambisonics:2", "array"}) {
    const std::string message = error_message([&] { ListenerLayout::named(name + ":"); });
    EXPECT_NE(message.find(name + ":"), std::string::npos) << message;
  }
}

// Texts alone say whether a file is opened.
TEST(ListenerLayout, SaysWhichNamesAreOfFiles) {
  for (const char* name : {"array:mics.yaml", "array:", "mono:b.json", "mono:/a/b.yaml", "mono:b.yml", "mono:array:b.json"})
    EXPECT_TRUE(names_file(name)) << name;
  for (const char* name : {"mono", "mono:cardioid", "binaural", "stereo:ab", "ambisonic:1", "quad", "json", ""})
    EXPECT_FALSE(names_file(name)) << name;
}

TEST(ListenerLayout, RefusesWhatCannotBe) {
  EXPECT_THROW(ListenerLayout::ambisonics(10), InputError);
  EXPECT_THROW(ListenerLayout::array({}), InputError);
  EXPECT_THROW(ListenerLayout::array({{.position_m = {0, 11, 0}}}), InputError);
  EXPECT_THROW(ListenerLayout::array({{.orientation = {2, 0, 0, 0}}}), InputError);
}

class ArrayFile : public testing::Test {
 protected:
  ~ArrayFile() override { std::filesystem::remove(path_); }
  ListenerLayout read(const std::string& text) {
    std::ofstream(path_) << text;
    return ListenerLayout::from_file(path_);
  }
  void expect_refused(const std::string& text, const std::string& part) {
    try {
      read(text);
      ADD_FAILURE() << "accepted " << text;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(part), std::string::npos) << error.what();
      EXPECT_NE(std::string(error.what()).find(path_.filename().string()), std::string::npos) << error.what();
    }
  }
  std::filesystem::path path_ = std::filesystem::temp_directory_path() / ("earshot_array_" + std::to_string(::getpid()) + ".yaml");
};

TEST_F(ArrayFile, IsRead) {
  const ListenerLayout layout = read(R"(
microphones:
  - {name: left, position_m: [-0.1, 0, 0.02]}
  - {name: right, position_m: [0.1, 0, 0], pattern: cardioid, azimuth_deg: -90}
  - {omni_weight: 0.25, elevation_deg: 90, lowpass_hz: 120}
)");
  ASSERT_EQ(layout.num_channels(), 3);
  EXPECT_EQ(layout.microphones[0].name, "left");
  EXPECT_EQ(layout.microphones[0].position_m, glm::vec3(-0.1f, 0, 0.02f));
  EXPECT_EQ(layout.microphones[0].directivity, nullptr);
  EXPECT_EQ(layout.microphones[2].position_m, glm::vec3(0));
  EXPECT_EQ(layout.microphones[2].lowpass_hz, 120.f);
  EXPECT_EQ(layout.microphones[0].lowpass_hz, 0.f);
  // The second looks to the right: counter-clockwise angles, so -90.
  const auto gain = [&](std::size_t i, glm::vec3 from) {
    const Microphone& microphone = layout.microphones[i];
    return microphone.directivity->pressure(glm::conjugate(microphone.orientation) * from, 1000.f);
  };
  EXPECT_NEAR(gain(1, {1, 0, 0}), 1.f, 1e-6f);
  EXPECT_NEAR(gain(1, {-1, 0, 0}), 0.f, 1e-6f);
  EXPECT_NEAR(gain(2, {0, 1, 0}), 1.f, 1e-6f);
  EXPECT_NEAR(gain(2, {0, -1, 0}), -0.5f, 1e-6f);
}

// Opening a pipe would wait for who writes into it.
TEST_F(ArrayFile, APipeIsRefused) {
  const std::string pipe = path_.string() + ".fifo.yaml";
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  for (const std::string& name : {"array:" + pipe, "mono:" + pipe})
    EXPECT_NE(error_message([&] { ListenerLayout::named(name); }).find("is a device, a pipe or a socket"), std::string::npos) << name;
  expect_refused("microphones: [{pattern: " + path_.filename().string() + ".fifo.yaml}]", "is a device, a pipe or a socket");
  std::filesystem::remove(pipe);
}

TEST_F(ArrayFile, BadOnesAreRefused) {
  expect_refused("microphones: []", "microphones");
  expect_refused("mics: []", "mics");
  expect_refused("microphones: {a: 1}", "microphones");
  expect_refused("microphones: [{position: [0, 0, 0]}]", "position");
  expect_refused("microphones: [{position_m: [0, 0]}]", "position_m");
  expect_refused("microphones: [{position_m: [0, 0, .nan]}]", "position_m");
  expect_refused("microphones: [{position_m: [0, 0, 0], pattern: cardioid, omni_weight: 0.5}]", "omni_weight");
  expect_refused("microphones: [{position_m: [0, 0, 0], gain: 2}]", "gain");
  expect_refused("microphones: [{lowpass_hz: 5}]", "lowpass_hz");
  expect_refused("microphones:\n  - {name: a}\n  - {azimut_deg: 5}", ":3");
  expect_refused("microphones:\n  - {name: a}\n  - {azimut_deg: 5}", "azimuth_deg");
  expect_refused("microphones: [{position_m: [0, 0, 0], name: a}, {position_m: [0, 0, 1], name: a}]", "'a' twice");
  expect_refused("microphones: [{position_m: [0, 0, 0], name: mic1}, {position_m: [0, 0, 1]}]",
                 "'mic1' twice");  // the name of an unnamed one
}

}  // namespace
}  // namespace earshot
