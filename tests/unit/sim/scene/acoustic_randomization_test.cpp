// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/acoustic_randomization.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <map>
#include <set>
#include <string>

#include "sim/base/errors.h"
#include "sim/scene/appearance.h"
#include "sim/scene/checks/scene_check.h"
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

constexpr int kOctaves = 9;  // 63 Hz to 16 kHz
/// Mean over a base-ten octave (IEC 61260-1:2014), which the engine takes for its bands.
float octave_mean(const CoefficientCurve& curve, int octave) {
  const auto edge = [&](double offset) { return static_cast<float>(1000 * std::pow(10, 0.3 * (octave - 4 + offset))); };
  return curve.band_mean(edge(-0.5), edge(0.5));
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
  constexpr int keys = 3000, octaves = kOctaves;
  constexpr double n = keys * octaves;
  for (const CoefficientCurve Material::*curve : {&Material::absorption, &Material::scattering}) {
    double sum = 0, squares = 0, fourth = 0;
    for (int key = 0; key < keys; ++key) {
      const Material noisy = with_noise(middle, {.seed = 3}, "scene", std::to_string(key));
      for (int octave = 0; octave < octaves; ++octave) {
        const double d = (octave_mean(noisy.*curve, octave) - 0.5) / 0.05;
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
    const Material noisy = with_noise(middle, {.seed = 3}, "scene", std::to_string(key));
    for (int octave = 0; octave < octaves; ++octave) {
      const double d = (10 * std::log10(octave_mean(noisy.transmission, octave)) + 40) / 3;
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
    const double third = octave_mean(noisy.absorption, 2) - 0.5;
    same_octave += third * (octave_mean(noisy.scattering, 2) - 0.5) / 0.0025;
    next_octave += third * (octave_mean(noisy.absorption, 3) - 0.5) / 0.0025;
    for (const float t : noisy.transmission.value) ASSERT_EQ(t, 0.f);  // what is opaque stays so
  }
  EXPECT_NEAR(same_octave / keys, 0, 4 / std::sqrt(keys));
  EXPECT_NEAR(next_octave / keys, 0, 4 / std::sqrt(keys));
}

/// Deviation of each octave and correlation of each pair of neighbours, over seeds and keys.
struct OctaveStatistics {
  std::array<double, kOctaves> mean{}, deviation{}, with_next{}, with_second{};
};
OctaveStatistics statistics_of(const CoefficientCurve Material::*curve, const std::vector<Material>& drawn) {
  OctaveStatistics result;
  std::vector<std::array<double, kOctaves>> values;
  for (const Material& material : drawn) {
    std::array<double, kOctaves>& octaves = values.emplace_back();
    for (int k = 0; k < kOctaves; ++k) octaves[k] = octave_mean(material.*curve, k);
  }
  const auto n = static_cast<double>(values.size());
  for (const auto& octaves : values)
    for (int k = 0; k < kOctaves; ++k) result.mean[k] += octaves[k] / n;
  const auto covariance = [&](int a, int b) {
    double sum = 0;
    for (const auto& octaves : values) sum += (octaves[a] - result.mean[a]) * (octaves[b] - result.mean[b]);
    return sum / n;
  };
  for (int k = 0; k < kOctaves; ++k) result.deviation[k] = std::sqrt(covariance(k, k));
  for (int k = 0; k + 1 < kOctaves; ++k) result.with_next[k] = covariance(k, k + 1) / (result.deviation[k] * result.deviation[k + 1]);
  for (int k = 0; k + 2 < kOctaves; ++k) result.with_second[k] = covariance(k, k + 2) / (result.deviation[k] * result.deviation[k + 2]);
  return result;
}

/// A room with `count` objects of one category, an object with a slot of its own and one without a category.
struct ObjectRoom {
  TriangleMesh mesh;
  std::vector<Material> materials;
  ImportReport report;
  explicit ObjectRoom(int count, const Material& material) {
    for (int i = 0; i < count; ++i)
      append_box(mesh, glm::vec3(2.f * static_cast<float>(i), 0, 0), glm::vec3(2.f * static_cast<float>(i) + 1, 1, 1),
                 intern(mesh.material_names, "chair"), intern(mesh.object_names, "chair_" + std::to_string(i)));
    append_box(mesh, {0, 2, 0}, {1, 3, 1}, intern(mesh.material_names, "plain"), intern(mesh.object_names, "thing"));
    materials.assign(mesh.material_names.size(), material);
  }
};

// Ten settings; 400 seeds with eight draws each.  The standard errors of a deviation and of a correlation r over n normal numbers are
// 1 / sqrt(2 n) and (1 - r^2) / sqrt(n); 4.5 of them, since there are 600 comparisons.  Coefficients lie four deviations and more from 0
// and 1, so that clipping plays no part, and vary within the octaves.
TEST(AcousticRandomization, OctavesHaveTheDeviationAndCorrelationThatAreAsked) {
  Material middle = Material::uniform("m", 0.5f, 0.5f, 0.f);
  middle.absorption = {{100, 300, 1000, 5000}, {0.46f, 0.52f, 0.5f, 0.54f}};
  constexpr int kSeeds = 400, kDraws = 8;
  const double n = kSeeds * kDraws;
  const MaterialDatabase database = MaterialDatabase::builtin();
  const SemanticMaterials semantics = SemanticMaterials::indoor();
  std::uint64_t state = 40;
  const auto draw = [&] {
    return static_cast<double>((state = 6364136223846793005u * state + 1442695040888963407u) >> 40) / double{1 << 24};
  };
  for (int setting = 0; setting < 10; ++setting) {
    AcousticRandomization randomization;
    randomization.candidates = false;
    randomization.uniform = setting % 2 == 1;
    randomization.per = setting % 4 < 2 ? RandomizedUnit::category : RandomizedUnit::object;
    randomization.noise_std = static_cast<float>(setting == 0 ? 0.1 : 0.02 + 0.08 * draw());
    randomization.noise_correlation = static_cast<float>(setting < 2 ? 0 : 0.95 * draw());
    std::vector<Material> drawn;
    for (int seed = 0; seed < kSeeds; ++seed) {
      randomization.seed = static_cast<std::uint64_t>(1000 * setting + seed);
      if (randomization.per == RandomizedUnit::object) {
        ObjectRoom room(kDraws, middle);
        randomize_materials("room", room.mesh, room.materials, room.report, true, semantics, database, randomization);
        drawn.insert(drawn.end(), room.materials.begin(), room.materials.begin() + kDraws);
      } else {
        for (int key = 0; key < kDraws; ++key)
          drawn.push_back(with_noise(middle, randomization, "room", "category " + std::to_string(key)));
      }
    }
    const double asked = randomization.uniform ? 1 / std::sqrt(12) : static_cast<double>(randomization.noise_std);
    const auto r = static_cast<double>(randomization.noise_correlation);
    // A uniform number has the fourth moment 9/5, so that its deviation has an error of sqrt(0.8) / (2 sqrt(n)).
    const double deviation_error = randomization.uniform ? std::sqrt(0.8) / (2 * std::sqrt(n)) : 1 / std::sqrt(2 * n);
    for (const CoefficientCurve Material::*curve : {&Material::absorption, &Material::scattering}) {
      const OctaveStatistics found = statistics_of(curve, drawn);
      for (int k = 0; k < kOctaves; ++k) {
        const double middle_value = randomization.uniform ? 0.5 : static_cast<double>(octave_mean(middle.*curve, k));
        EXPECT_NEAR(found.mean[k], middle_value, 4.5 * asked / std::sqrt(n)) << setting << " " << k;
        EXPECT_NEAR(found.deviation[k] / asked, 1, 4.5 * deviation_error) << setting << " " << k;
      }
      for (int k = 0; k + 1 < kOctaves; ++k) EXPECT_NEAR(found.with_next[k], r, 4.5 / std::sqrt(n)) << setting << " " << k;
      for (int k = 0; k + 2 < kOctaves && !randomization.uniform; ++k)
        EXPECT_NEAR(found.with_second[k], r * r, 4.5 / std::sqrt(n)) << setting << " " << k;
    }
  }
}

// Noise changes absorption, so that a measured impedance is none of it; without noise both stay.
TEST(AcousticRandomization, MeasuredImpedanceStaysWithoutNoise) {
  Material measured = Material::uniform("m", 0.5f, 0.5f, 0.f);
  measured.impedance_real = {{125, 1000}, {1.5f, 2.f}};
  measured.impedance_imaginary = {{125, 1000}, {-3.f, -0.5f}};
  for (int key = 0; key < 10; ++key) {
    const auto drawn = [&](float noise_std, bool uniform) {
      return with_noise(measured, {.seed = 3, .uniform = uniform, .noise_std = noise_std}, "scene", std::to_string(key));
    };
    EXPECT_EQ(drawn(0, false).impedance_real.value, measured.impedance_real.value);
    EXPECT_EQ(drawn(0, false).impedance_imaginary.value, measured.impedance_imaginary.value);
    EXPECT_TRUE(drawn(0.05f, false).impedance_real.hz.empty());
    EXPECT_TRUE(drawn(0, true).impedance_imaginary.hz.empty());
  }
}

// With draws per object the file's colours are found, and the name of what has no category.
TEST(AcousticRandomization, ObjectsKeepLooksAndChecks) {
  const TempFolder folder;
  folder.write("room.mtl", "newmtl red\nKd 1 0.5 0\nnewmtl plain\nKd 0.2 0.2 0.2\n");
  folder.write("room.obj",
               "mtllib room.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 3 0 0\no table_3\nusemtl red\nf 1 2 3\no table_4\nf 1 2 4\n"
               "o thing\nusemtl plain\nf 2 5 3\n");
  const auto colors_of = [&](const std::string& keys) {
    const Scene scene = load_scene(folder.write("s.yaml", "mesh: room.obj\nrandomize: {seed: 1" + keys + "}\n"));
    std::map<std::string, std::array<float, 3>> colors;
    const auto appearance = load_appearance(scene);
    for (std::size_t t = 0; t < scene.mesh().triangles.size(); ++t) {
      const glm::vec3 color = appearance->triangle_color[t];
      colors[scene.mesh().object_names[scene.mesh().triangle_object[t]]] = {color.x, color.y, color.z};
    }
    return colors;
  };
  EXPECT_EQ(colors_of(", per: object"), colors_of(""));
  EXPECT_EQ(colors_of("").size(), 3u);
  EXPECT_EQ(colors_of("").at("table_3")[2], 0.f);

  TriangleMesh mesh;
  for (int i = 0; i < 2; ++i)
    append_box(mesh, glm::vec3(0, 3.f * static_cast<float>(i), 0), glm::vec3(4, 3.f * static_cast<float>(i) + 2, 4),
               intern(mesh.material_names, i == 0 ? "wall" : "unlabelled"), intern(mesh.object_names, i == 0 ? "wall_1" : "unlabelled_7"));
  ImportReport report;
  report.has_semantics = true;
  report.warnings = {"1 % of the area (12 of 24 triangles) has no category in a.house"};
  report.choices = {{.has_category = true}, {.reason = MaterialReason::fallback}};
  const Scene scene("room", std::move(mesh), std::vector<Material>(2, Material::uniform("m", 0.5f, 0.5f, 0.f)), {}, std::move(report));
  const Scene drawn = randomize_materials(scene, SemanticMaterials::indoor(), MaterialDatabase::builtin(), {.per = RandomizedUnit::object});
  EXPECT_EQ(scene_warnings(drawn), scene_warnings(scene));
}

TEST(AcousticRandomization, FullCorrelationIsOneDrawForAllOctaves) {
  const Material middle = Material::uniform("m", 0.5f, 0.5f, 0.f);
  for (const bool uniform : {false, true}) {
    const Material noisy = with_noise(middle, {.seed = 5, .uniform = uniform, .noise_correlation = 1}, "scene", "key");
    for (const float value : noisy.absorption.value) EXPECT_FLOAT_EQ(value, noisy.absorption.value[0]);
    EXPECT_NE(noisy.absorption.value[0], 0.5f);
  }
}

// Two chairs may differ; the parts of one have one draw, and other objects play no part.
TEST(AcousticRandomization, ObjectsHaveDrawsOfTheirOwn) {
  const MaterialDatabase database = MaterialDatabase::builtin();
  const SemanticMaterials semantics = SemanticMaterials::indoor();
  std::set<std::string> chairs;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const auto randomized_room = [&](int count, RandomizedUnit per) {
      ObjectRoom room(count, database.get("marble", ""));
      room.report.choices.assign(room.materials.size(), {});
      room.report.choices[1].by = "plain";
      randomize_materials("room", room.mesh, room.materials, room.report, true, semantics, database, {.seed = seed, .per = per});
      return room;
    };
    const ObjectRoom together = randomized_room(3, RandomizedUnit::category), apart = randomized_room(3, RandomizedUnit::object),
                     two = randomized_room(2, RandomizedUnit::object);
    EXPECT_EQ(together.materials.size(), 2u);
    ASSERT_EQ(apart.materials.size(), 4u);
    EXPECT_EQ(apart.mesh.material_names, (std::vector<std::string>{"chair/chair_0", "chair/chair_1", "chair/chair_2", "plain/thing"}));
    ASSERT_EQ(apart.report.choices.size(), 4u);
    EXPECT_EQ(apart.report.choices[3].by, "plain");
    for (int i = 0; i < 3; ++i) {
      EXPECT_EQ(apart.materials[i].category, "chair");
      EXPECT_NE(values_of(apart.materials[i]), values_of(apart.materials[(i + 1) % 3]));
      chairs.insert(apart.materials[i].name);
    }
    EXPECT_EQ(values_of(two.materials[1]), values_of(apart.materials[1]));
    for (std::size_t t = 0; t < apart.mesh.triangles.size(); ++t) EXPECT_EQ(apart.mesh.triangle_material[t], apart.mesh.triangle_object[t]);
  }
  EXPECT_GT(chairs.size(), 1u);
  EXPECT_EQ(semantics.category_of("chair/chair_0"), "chair");
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
