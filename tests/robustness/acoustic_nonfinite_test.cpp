// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>

#include "sim/acoustics/tracers/population_control.h"
#include "tests/support/acoustics/acoustic_engines.h"

/// What is not finite ends where it arises, is counted, and takes nothing else with it.
namespace earshot {
namespace {

using engines::Engine;
using engines::Heard;
using engines::kEngines;
using engines::name_of;

/// Behind (z > 0) the gain is `behind`, in front it is 1.
class BrokenPattern final : public Directivity {
 public:
  explicit BrokenPattern(float behind) : behind_(behind) {}
  [[nodiscard]] float pressure(glm::vec3 direction, float) const override { return direction.z > 0 ? behind_ : 1.f; }

 private:
  float behind_;
};

TEST(X_NonFinite, ABrokenPatternOfTheSourceSpoilsNothingElse) {
  for (const Engine engine : kEngines) {
    for (const float gain : {std::numeric_limits<float>::infinity(), std::numeric_limits<float>::quiet_NaN(), 1e30f}) {
      SCOPED_TRACE(name_of(engine) + " " + std::to_string(gain));
      AcousticConfig config;
      config.rays = 512;
      SoundSource source(rooms::shoe1_source());
      source.directivity = std::make_shared<const BrokenPattern>(gain);
      const Heard heard(engine, rooms::shoe1(0.2, 0.5), config, source, 512);
      if (engine == Engine::field) {
        EXPECT_GT(heard.field->nonfinite_dropped(), 0u);
      }
      for (const glm::vec3 listener : {rooms::shoe1_listener(), rooms::point(1, 3.5, 1), rooms::point(1, 0.5, 1)}) {
        const EnergyResponse response = heard.at(listener);
        EXPECT_TRUE(engines::is_finite(response));
        if (engine != Engine::field && !std::isfinite(gain * gain)) {
          EXPECT_GT(response.stats.nonfinite_dropped, 0u);
        }
        EXPECT_GT(engines::late_energy(response), 0.0);  // what went to the front is still heard
        engines::expect_sound(measure(heard.scene, response));
      }
    }
  }
}

TEST(X_NonFinite, OneBadRayOfAPopulationEndsAlone) {
  struct Ray {
    bool alive = true;
    float reflected[8] = {};
  };
  for (const float bad : {std::numeric_limits<float>::infinity(), std::numeric_limits<float>::quiet_NaN()}) {
    std::array<Ray, 64> rays;
    double before = 0;
    for (std::size_t i = 0; i < rays.size(); ++i) {
      rays[i].reflected[0] = i % 16 == 3 ? 100.f : 1.f;  // uneven: some end, some split
      if (i != 17) before += static_cast<double>(rays[i].reflected[0]);
    }
    rays[17].reflected[0] = bad;
    EXPECT_EQ((control_population<8>(1, std::span<Ray>(rays), 0.3)), 1);
    double after = 0;
    for (const Ray& ray : rays)
      if (ray.alive) after += static_cast<double>(ray.reflected[0]);
    EXPECT_NEAR(after, before, 1e-4 * before);  // one band: resampling keeps the sum exactly
  }
}

TEST(X_NonFinite, EnergyThatOverflowsIsNotHeard) {
  // A response cannot hold more than floats do: what would is dropped by the synthesis, which stays finite.
  EnergyResponse response;
  response.speed_of_sound_m_per_s = 343.f;
  AcousticConfig config = rooms::plain_config();
  config.bands = 0;
  response.late = EnergyHistogram(125, 7, 1, 0.004f);
  for (std::size_t i = 0; i < response.late.values().size(); i += 4)
    response.late.values()[i] = i % 8 == 0    ? std::numeric_limits<float>::infinity()
                                : i % 12 == 0 ? std::numeric_limits<float>::quiet_NaN()
                                              : 1e-3f;
  RirSynthesizer synthesizer(make_synthesis_tables(config, BandLayout::octaves(16000.f), ChannelLayout::mono, nullptr));
  Rir rir;
  synthesizer.render(response, 0.0, 1, rir);
  for (const float sample : rir.samples) ASSERT_TRUE(std::isfinite(sample));
}

}  // namespace
}  // namespace earshot
