// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/acoustic_randomization.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <set>
#include <string>

#include "sim/base/errors.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

std::vector<float> values_of(const Material& m) {
  std::vector<float> values;
  for (const CoefficientCurve* curve : {&m.absorption, &m.scattering, &m.transmission}) {
    values.insert(values.end(), curve->value.begin(), curve->value.end());
  }
  return values;
}

const std::vector<std::string> kSlots = {"wall", "floor", "sofa_3", "nothing known", "wall_2"};

std::vector<Material> randomized(std::uint64_t seed, std::string_view scene = "a.glb", const std::vector<std::string>& slots = kSlots) {
  static const MaterialDatabase database = MaterialDatabase::builtin();
  static const SemanticMaterials semantics = SemanticMaterials::indoor();
  const std::vector<Material> slot_materials(slots.size(), database.get("marble", ""));
  return randomize_materials(scene, slots, slot_materials, semantics, database, {.seed = seed});
}

TEST(AcousticRandomization, IsAFunctionOfSeedSceneAndCategory) {
  const std::vector<Material> first = randomized(7), again = randomized(7), other_seed = randomized(8),
                              other_scene = randomized(7, "b.glb");
  for (std::size_t i = 0; i < kSlots.size(); ++i) {
    EXPECT_EQ(values_of(first[i]), values_of(again[i]));
    EXPECT_NE(values_of(first[i]), values_of(other_seed[i]));
    EXPECT_NE(values_of(first[i]), values_of(other_scene[i]));
  }
  EXPECT_EQ(values_of(first[0]), values_of(first[4])) << "both are walls";
  EXPECT_EQ(first[2].category, "sofa");
  EXPECT_EQ(first[3].category, "");
  EXPECT_EQ(first[3].name, "marble") << "without a category it stays what it is";
  // Neither the other slots nor their order matter, nor the folder of the scene.
  EXPECT_EQ(values_of(randomized(7, "a.glb", {"sofa"})[0]), values_of(first[2]));
  EXPECT_EQ(values_of(randomized(7, "/some/where/a.glb")[0]), values_of(first[0]));
}

TEST(AcousticRandomization, AllValuesArePhysical) {
  std::set<std::string> walls;
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    for (const Material& m : randomized(seed)) {
      ASSERT_EQ(m.absorption.hz, m.transmission.hz);
      for (std::size_t i = 0; i < m.absorption.hz.size(); ++i) {
        const float a = m.absorption.value[i], s = m.scattering.value[i], t = m.transmission.value[i];
        ASSERT_TRUE(a >= 0 && a <= 1 && s >= 0 && s <= 1 && t >= 0 && t <= a) << m.name << " " << a << " " << s << " " << t;
      }
    }
    walls.insert(randomized(seed)[0].name);
  }
  // Seven kinds of wall; the chance that 200 draws miss one is 7 (6/7)^200 = 3e-13.
  EXPECT_EQ(walls.size(), SemanticMaterials::indoor().all().at("wall").size());
}

// Before clipping: coefficients of 0.5 with a standard deviation of 0.05 are ten of them away from 0 and 1.
TEST(AcousticRandomization, NoiseIsGaussianOfTheStatedSize) {
  Material middle = Material::uniform("m", 0.5f, 0.5f, 1e-4f);
  constexpr int keys = 3000, octaves = 7;
  constexpr double n = keys * octaves;
  for (const CoefficientCurve Material::*curve : {&Material::absorption, &Material::scattering}) {
    double sum = 0, squares = 0, fourth = 0;
    for (int key = 0; key < keys; ++key) {
      const Material noisy = with_noise(middle, {.seed = 3}, "scene", std::to_string(key));
      ASSERT_EQ((noisy.*curve).value.size(), static_cast<std::size_t>(octaves));
      for (const float value : (noisy.*curve).value) {
        const double d = (value - 0.5) / 0.05;
        sum += d;
        squares += d * d;
        fourth += d * d * d * d;
      }
    }
    // Standard errors of the mean, the variance and the fourth moment of unit normals: 1, sqrt(2) and sqrt(96) over sqrt(n).
    EXPECT_NEAR(sum / n, 0, 4 / std::sqrt(n));
    EXPECT_NEAR(squares / n, 1, 4 * std::sqrt(2 / n));
    EXPECT_NEAR(fourth / n, 3, 4 * std::sqrt(96 / n));
  }
  // Transmission: 3 dB about -40 dB.
  double sum_db = 0, squares_db = 0;
  for (int key = 0; key < keys; ++key) {
    for (const float value : with_noise(middle, {.seed = 3}, "scene", std::to_string(key)).transmission.value) {
      const double d = (10 * std::log10(value) + 40) / 3;
      sum_db += d;
      squares_db += d * d;
    }
  }
  EXPECT_NEAR(sum_db / n, 0, 4 / std::sqrt(n));
  EXPECT_NEAR(squares_db / n, 1, 4 * std::sqrt(2 / n));
}

TEST(AcousticRandomization, OctavesAndCoefficientsAreIndependent) {
  const Material middle = Material::uniform("m", 0.5f, 0.5f, 0.f);
  constexpr int keys = 4000;
  double same_octave = 0, next_octave = 0;
  for (int key = 0; key < keys; ++key) {
    const Material noisy = with_noise(middle, {.seed = 5}, "scene", std::to_string(key));
    same_octave += (noisy.absorption.value[2] - 0.5) * (noisy.scattering.value[2] - 0.5) / 0.0025;
    next_octave += (noisy.absorption.value[2] - 0.5) * (noisy.absorption.value[3] - 0.5) / 0.0025;
    for (const float t : noisy.transmission.value) ASSERT_EQ(t, 0.f);  // what is opaque stays so
  }
  EXPECT_NEAR(same_octave / keys, 0, 4 / std::sqrt(keys));
  EXPECT_NEAR(next_octave / keys, 0, 4 / std::sqrt(keys));
}

TEST(AcousticRandomization, WithoutNoiseTheChoiceAloneIsRandom) {
  const MaterialDatabase database = MaterialDatabase::builtin();
  const SemanticMaterials semantics = SemanticMaterials::indoor();
  const std::vector<std::string> slots = {"floor"};
  const std::vector<Material> slot_materials = {database.get("marble", "")};
  std::map<std::string, int> count;
  constexpr int draws = 400;
  for (int seed = 0; seed < draws; ++seed) {
    const Material m = randomize_materials("s", slots, slot_materials, semantics, database,
                                           {.seed = static_cast<std::uint64_t>(seed), .noise_std = 0, .transmission_noise_db = 0})[0];
    if (seed < 50) {
      EXPECT_FLOAT_EQ(m.absorption.at(1000), database.get(m.name, "").absorption.at(1000));
    }
    ++count[m.name];
  }
  // Ten kinds of floor, each 40 times on average; 6 standard deviations of a binomial of 400 and 1/10 are 36.
  EXPECT_EQ(count.size(), semantics.all().at("floor").size());
  for (const auto& [name, times] : count) EXPECT_NEAR(times, 400 / static_cast<int>(count.size()), 36) << name;
  const AcousticRandomization fixed{.seed = 1, .candidates = false};
  EXPECT_EQ(randomize_materials("s", slots, slot_materials, semantics, database, fixed)[0].name, "marble");
}

TEST(AcousticRandomization, ScenesAndTheirFilesTakeIt) {
  const TempFolder folder;
  const auto load = [&](const std::string& keys) { return load_scene(folder.write("s.yaml", "mesh: house:5,rooms=2\n" + keys)); };
  const Scene plain = load("semantics: indoor\n"), one = load("randomize: {seed: 1}\n"), same = load("randomize: {seed: 1}\n"),
              two = load("randomize: {seed: 2}\n");
  EXPECT_EQ(one.hash(), same.hash());
  EXPECT_NE(one.hash(), two.hash());
  EXPECT_NE(one.hash(), plain.hash());
  EXPECT_EQ(one.mesh().triangles, plain.mesh().triangles);

  const Scene drawn = randomize_materials(plain, SemanticMaterials::indoor(), MaterialDatabase::builtin(), {.seed = 1});
  EXPECT_EQ(drawn.mesh().triangles, plain.mesh().triangles);
  EXPECT_EQ(drawn.materials().size(), plain.materials().size());
  int changed = 0, with_category = 0;
  for (std::size_t slot = 0; slot < drawn.materials().size(); ++slot) {
    changed += drawn.materials()[slot].name != plain.materials()[slot].name ? 1 : 0;
    with_category += plain.materials()[slot].category.empty() ? 0 : 1;
  }
  EXPECT_GT(with_category, 5);
  EXPECT_GT(changed, 0);
}

}  // namespace
}  // namespace earshot
