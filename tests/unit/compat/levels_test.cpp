// SPDX-License-Identifier: Apache-2.0
// Levels and times against closed forms: the open, and the first reflection of a floor.

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "compat/rlr_audio_propagation.h"
#include "sim/base/random.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using Point = std::array<double, 3>;

std::array<float, 3> floats(const Point& point, double unit_m) {
  return {static_cast<float>(point[0] / unit_m), static_cast<float>(point[1] / unit_m), static_cast<float>(point[2] / unit_m)};
}

/// One source, one omnidirectional listener; sum of its samples, which is the area of all impulses.
class OnePair {
 public:
  explicit OnePair(const RLRA_ContextConfiguration& configuration) : unit_m_(static_cast<double>(configuration.unitScale)) {
    EXPECT_EQ(RLRA_CreateContext(&context_, &configuration), RLRA_Success);
    const RLRA_ChannelLayout layout{1, RLRA_Layout_Mono};
    EXPECT_EQ(RLRA_AddSource(context_), RLRA_Success);
    EXPECT_EQ(RLRA_AddListener(context_, &layout), RLRA_Success);
  }
  OnePair(const OnePair&) = delete;
  OnePair& operator=(const OnePair&) = delete;
  ~OnePair() { RLRA_DestroyContext(context_); }

  [[nodiscard]] RLRA_Context context() const { return context_; }
  double area(const Point& source, const Point& listener) {
    EXPECT_EQ(RLRA_SetSourcePosition(context_, 0, floats(source, unit_m_).data()), RLRA_Success);
    EXPECT_EQ(RLRA_SetListenerPosition(context_, 0, floats(listener, unit_m_).data()), RLRA_Success);
    EXPECT_EQ(RLRA_Simulate(context_), RLRA_Success);
    const float* samples = RLRA_GetIRChannel(context_, 0, 0, 0);
    double sum = 0;
    for (std::size_t i = 0; i < RLRA_GetIRSampleCount(context_, 0, 0); ++i) sum += static_cast<double>(samples[i]);
    return sum;
  }

 private:
  double unit_m_;
  RLRA_Context context_ = nullptr;
};

RLRA_ContextConfiguration quick_configuration_of(const RandomStream& random) {
  RLRA_ContextConfiguration configuration;
  EXPECT_EQ(RLRA_ContextConfigurationDefault(&configuration), RLRA_Success);
  configuration.indirectRayCount = 16;
  configuration.sampleRate = std::array{16000.f, 22050.f, 44100.f}[random.below(3, 0)];
  configuration.maxIRLength = 0.2f;
  configuration.unitScale = std::array{1.f, 0.01f, 0.3048f}[random.below(3, 1)];
  configuration.globalVolume = std::pow(2.f, 6.f * random.uniform(2) - 3.f);
  return configuration;
}

double distance(const Point& a, const Point& b) { return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]); }

// Pressure 1 / (4 pi r) times the volume.  1 %: absorption in air at the lowest frequencies, which the sum of samples is, and the ripple of
// a delayed impulse; the positions are floats.
TEST(CompatLevels, AUnitSourceInTheOpen) {
  for (std::uint32_t draw = 0; draw < 20; ++draw) {
    const RandomStream random(3, Purpose::test, draw);
    const RLRA_ContextConfiguration configuration = quick_configuration_of(random);
    OnePair pair(configuration);
    Point source{}, listener{};
    for (std::uint32_t axis = 0; axis < 3; ++axis) {
      source[axis] = 8 * random.uniform(10 + axis) - 4;
      listener[axis] = 8 * random.uniform(20 + axis) + 5;
    }
    const double expected = static_cast<double>(configuration.globalVolume) / (4 * std::numbers::pi * distance(source, listener));
    EXPECT_NEAR(pair.area(source, listener) / expected, 1, 0.01) << draw;
  }
}

// A rigid floor without scattering adds the image source.  The floor is 400 m wide, so that its edges come after the response ends.
TEST(CompatLevels, AFloorAddsItsImage) {
  const TempFolder folder;
  for (std::uint32_t draw = 0; draw < 8; ++draw) {
    const RandomStream random(4, Purpose::test, draw);
    RLRA_ContextConfiguration configuration = quick_configuration_of(random);
    configuration.maxIRLength = 0.1f;
    OnePair pair(configuration);
    const float scale = configuration.unitScale;
    const std::array<float, 12> corners{-200, 0, -200, 200, 0, -200, 200, 0, 200, -200, 0, 200};
    std::array<float, 12> vertices = corners;
    for (float& value : vertices) value /= scale;
    const std::array<std::uint32_t, 4> face{0, 1, 2, 3};
    const std::string database = folder.write(
        "materials.json", R"({"materials": [{"name": "rigid", "labels": ["floor"], "absorption": [125, 0], "scattering": [125, 0]}]})");
    ASSERT_EQ(RLRA_SetMaterialDatabaseJSON(pair.context(), database.c_str()), RLRA_Success);
    ASSERT_EQ(RLRA_AddObject(pair.context()), RLRA_Success);
    ASSERT_EQ(RLRA_AddMeshVertices(pair.context(), vertices.data(), 4), RLRA_Success);
    ASSERT_EQ(RLRA_AddMeshIndices(pair.context(), face.data(), 4, 4, "The Floor"), RLRA_Success);
    ASSERT_EQ(RLRA_FinalizeObjectMesh(pair.context(), 0), RLRA_Success);
    const Point source{random.uniform(10), 1 + random.uniform(11), random.uniform(12)};
    const Point listener{2 + random.uniform(20), 1 + random.uniform(21), 3 + random.uniform(22)};
    const Point image{source[0], -source[1], source[2]};
    const double expected = static_cast<double>(configuration.globalVolume) / (4 * std::numbers::pi) *
                            (1 / distance(source, listener) + 1 / distance(image, listener));
    EXPECT_NEAR(pair.area(source, listener) / expected, 1, 0.02) << draw;
  }
}

}  // namespace
}  // namespace earshot
