// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/acoustic_surfaces.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/model/lobe_shares.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/effect_scenes.h"

namespace earshot {
namespace {

TEST(AcousticSurfaces, ThePlanIsAFunctionOfThem) {
  for (const effects::EffectScene& where : {effects::two_rooms_scene(0.9, 0.01), effects::open_field_scene()}) {
    AcousticConfig config;
    config.rir_length_s = 0;  // left to the plan
    const AcousticSurfaces surfaces(where.scene, config);
    const EffectPlan plan = plan_effects(surfaces);
    const AcousticScene scene(where.scene, config);
    EXPECT_EQ(plan.rir_length_s, scene.plan().rir_length_s);
    EXPECT_EQ(plan.image_order, scene.image_order());
    EXPECT_EQ(plan.air, scene.plan().air);
    EXPECT_EQ(plan.traced_transmission, traces_transmission(scene));
    ASSERT_EQ(plan.decisions.size(), scene.plan().decisions.size());
    for (std::size_t i = 0; i < plan.decisions.size(); ++i) EXPECT_EQ(plan.decisions[i].why, scene.plan().decisions[i].why);
  }
}

TEST(AcousticSurfaces, KeepTheConfigAsGivenAndTheSceneFillsItIn) {
  AcousticConfig config;
  config.rir_length_s = 0;
  const AcousticScene scene(rooms::shoe1(0.2, 0.5), config);
  EXPECT_EQ(scene.surfaces().config().rir_length_s, 0.f);
  EXPECT_EQ(scene.config().rir_length_s, scene.plan().rir_length_s);
  EXPECT_GT(scene.config().rir_length_s, 0.f);

  const AcousticScene silent(rooms::shoe1(1, 0), AcousticConfig{});  // nothing comes back
  EXPECT_EQ(silent.surfaces().config().late, Switch::automatic);
  EXPECT_EQ(silent.config().late, Switch::off);
}

TEST(AcousticSurfaces, LargestSpecularReflectanceIsOverMaterialsAndBands) {
  std::array<Material, 6> walls = rooms::uniform_walls(0.5, 0.5);
  EXPECT_FLOAT_EQ(AcousticSurfaces(rooms::box(5, 4, 3, walls), {}).largest_specular_reflectance(), 0.25f);
  walls[4] = Material::uniform("floor", 0.1f, 0.2f);
  EXPECT_FLOAT_EQ(AcousticSurfaces(rooms::box(5, 4, 3, walls), {}).largest_specular_reflectance(), 0.72f);
  EXPECT_EQ(AcousticSurfaces(rooms::empty(), {}).largest_specular_reflectance(), 0.f);
}

TEST(AcousticSurfaces, MeanAbsorptionIsByArea) {
  // 5 x 4 x 3 m: the floor is 20 of 94 square metres.
  std::array<Material, 6> walls = rooms::uniform_walls(0.5, 0.5);
  walls[4] = Material::uniform("floor", 0.1f, 0.2f);
  const AcousticSurfaces box(rooms::box(5, 4, 3, walls), {}), empty(rooms::empty(), {});
  ASSERT_EQ(box.mean_absorption().size(), 7u);
  for (const double mean : box.mean_absorption()) EXPECT_NEAR(mean, (74 * 0.5 + 20 * 0.1) / 94, 1e-6);
  for (const double mean : empty.mean_absorption()) EXPECT_EQ(mean, 0.0);
}

TEST(AcousticSurfaces, RefuseABrokenConfig) {
  AcousticConfig config;
  config.early_order = 5;
  EXPECT_THROW(AcousticSurfaces(rooms::shoe1(0.2, 0.5), config), InputError);
}

// Lobes have no angle of incidence: whatever the exponent, wherever the material is.
TEST(AcousticSurfaces, RefuseLobesBesideReflectionByTheAngle) {
  for (std::uint32_t number = 0; number < 12; ++number) {
    const RandomStream random(511, Purpose::test, number);
    std::array<Material, 6> walls = rooms::uniform_walls(0.3, 0.2);
    walls[number % 6].locally_reacting = true;
    walls[number % 6].name = "panel";
    const auto room = rooms::box(5, 4, 3, walls);
    AcousticConfig config;
    config.specular_exponent = number < 3 ? kExponentFromScattering : 1.f + 900.f * random.uniform(0);
    try {
      const AcousticSurfaces surfaces(room, config);
      ADD_FAILURE() << config.specular_exponent;
    } catch (const InputError& error) {
      const std::string text = error.what();
      for (const char* part : {"specular_exponent", "angle: locally_reacting", "panel"})
        EXPECT_NE(text.find(part), std::string::npos) << text;
    }
    config.specular_exponent = 0;
    EXPECT_TRUE(AcousticSurfaces(room, config).any_reacts_locally());
  }
}

// A lobe of the ladder is a constant: every scene and configuration has the same one.
TEST(AcousticSurfaces, ShareTheLobesOfTheLadder) {
  AcousticConfig config;
  config.specular_exponent = kExponentFromScattering;
  int shared = 0;
  for (std::uint32_t number = 0; number < 10; ++number) {
    const RandomStream random(512, Purpose::test, number);
    const double scattering = 0.01 + 0.9 * double{random.uniform(0)};
    const AcousticSurfaces first(rooms::shoe1(0.2, scattering), config), second(rooms::shoe1(0.5, scattering), config);
    ASSERT_EQ(first.specular_lobes().size(), kLobeLadder);
    for (std::size_t i = 0; i < kLobeLadder; ++i) {
      EXPECT_EQ(first.specular_lobes()[i], second.specular_lobes()[i]);
      shared += first.specular_lobes()[i] != nullptr;
    }
  }
  EXPECT_GE(shared, 10);
}

}  // namespace
}  // namespace earshot
