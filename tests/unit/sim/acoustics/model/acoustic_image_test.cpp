// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/acoustic_image.h"

#include <gtest/gtest.h>

#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "sim/acoustics/response/energy_response.h"
#include "sim/base/errors.h"
#include "tests/support/files/mutate.h"

namespace earshot {
namespace {

std::shared_ptr<const Scene> load(const char* spec) { return std::make_shared<const Scene>(load_scene(spec)); }

AcousticConfig quick() {
  AcousticConfig config;
  config.rays = 16;
  config.early_candidate_rays = 200;
  config.rir_length_s = 0.2f;
  config.field = Switch::off;
  return config;
}

/// Distances and energies of all arrivals, and the late field.
std::vector<float> heard(const AcousticScene& scene, glm::vec3 source, glm::vec3 listener) {
  const EarlyCandidates candidates(scene, source);
  EnergyResponse response;
  compute_energy_response(scene, candidates, listener, response);
  std::vector<float> values;
  for (const Arrival& arrival : response.arrivals) {
    values.push_back(arrival.distance_m);
    values.insert(values.end(), arrival.amplitude.begin(), arrival.amplitude.end());
    values.insert(values.end(), arrival.phase_rad.begin(), arrival.phase_rad.end());
  }
  const std::span<const float> late = std::as_const(response.late).values();
  values.insert(values.end(), late.begin(), late.end());
  return values;
}

TEST(AcousticImage, ResponsesAreTheSameBits) {
  for (const char* spec : {"house:3,rooms=3", "shoebox:6x3x4@0.2", "house:9,rooms=2,furnished=false"}) {
    const auto scene = load(spec);
    for (const Switch diffraction : {Switch::automatic, Switch::off}) {
      AcousticConfig config = quick();
      config.diffraction = diffraction;
      const AcousticScene built(scene, config);
      const AcousticScene back = decode_acoustics(encode_acoustics(built), scene, config, "memory");
      EXPECT_EQ(back.hash(), built.hash());
      EXPECT_EQ(back.planes().size(), built.planes().size());
      EXPECT_EQ(back.plan().decisions.size(), built.plan().decisions.size());
      const glm::vec3 size = scene->bounds().upper - scene->bounds().lower, lower = scene->bounds().lower;
      const glm::vec3 source = lower + 0.3f * size, listener = lower + glm::vec3(0.55f, 0.5f, 0.6f) * size;
      const std::vector<float> expected = heard(built, source, listener);
      ASSERT_GT(expected.size(), 20u);
      EXPECT_EQ(heard(back, source, listener), expected) << spec;
      EXPECT_EQ(encode_acoustics(back), encode_acoustics(built)) << spec;
    }
  }
}

TEST(AcousticImage, ThatOfAnotherSceneOrConfigIsRefused) {
  const auto scene = load("shoebox:6x3x4@0.2");
  const std::string image = encode_acoustics(AcousticScene(scene, quick()));
  EXPECT_THROW(decode_acoustics(image, load("shoebox:6x3x5@0.2"), quick(), "memory"), InputError);
  AcousticConfig bands = quick();
  bands.bands = 3;
  EXPECT_THROW(decode_acoustics(image, scene, bands, "memory"), InputError);
}

TEST(AcousticImage, DamagedImagesAreRefusedOrUsable) {
  const auto scene = load("house:2,rooms=1,area_m2=12");
  const std::string image = encode_acoustics(AcousticScene(scene, quick()));
  int refused = 0;
  for (std::uint32_t number = 0; number < 2000; ++number) {
    try {
      const AcousticScene back = decode_acoustics(mutated(image, number), scene, quick(), "memory");
      for (const std::uint32_t plane : back.plane_of_triangle()) ASSERT_LT(plane, back.planes().size());
    } catch (const InputError&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 500);
  for (std::size_t size = 0; size < image.size(); size += 97)
    EXPECT_THROW(decode_acoustics(image.substr(0, size), scene, quick(), "cut"), InputError);
}

}  // namespace
}  // namespace earshot
