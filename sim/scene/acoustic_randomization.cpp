// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/acoustic_randomization.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/random.h"
#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

constexpr int kOctaves = 7;  // 125 Hz to 8 kHz

// Draws of one key: the choice, then one pair per octave for absorption and scattering, then one per octave for transmission.
constexpr std::uint32_t kChoiceDraw = 0, kSurfaceDraw = 1, kTransmissionDraw = kSurfaceDraw + kOctaves;

float octave_hz(int octave) { return static_cast<float>(1000.0 * std::pow(10.0, 0.3 * (octave - 3))); }

RandomStream stream_of(std::uint64_t seed, std::string_view scene, std::string_view key) {
  const std::uint64_t place = hash64(std::filesystem::path(scene).filename().string());
  return {seed, Purpose::material, static_cast<std::uint32_t>(place), static_cast<std::uint32_t>(place >> 32),
          static_cast<std::uint32_t>(hash64(key))};
}

std::string key_of(const std::string& category, const Material& material) {
  return category.empty() ? "material " + material.name : "category " + category;
}

}  // namespace

void read(ConfigReader& reader, AcousticRandomization& randomization) {
  reader.read("candidates", randomization.candidates,
              "Draws the material of each semantic category from its candidates. false: materials stay, with noise.");
  reader.read("noise_std", randomization.noise_std, Allowed::between(0, 1),
              "Standard deviation of the noise on absorption and scattering coefficients.");
  reader.read("transmission_noise_db", randomization.transmission_noise_db, Allowed::between(0, 60),
              "Standard deviation of the noise on transmission losses.");
}

Material with_noise(const Material& material, const AcousticRandomization& randomization, std::string_view scene, std::string_view key) {
  const RandomStream random = stream_of(randomization.seed, scene, key);
  Material noisy = material;
  noisy.absorption = noisy.scattering = noisy.transmission = {};
  noisy.impedance_real = noisy.impedance_imaginary = {};  // that of the noisy absorption
  for (int octave = 0; octave < kOctaves; ++octave) {
    const float hz = octave_hz(octave);
    const auto [on_absorption, on_scattering] = random.normal2(kSurfaceDraw + static_cast<std::uint32_t>(octave));
    const float on_transmission = random.normal2(kTransmissionDraw + static_cast<std::uint32_t>(octave))[0];
    const float absorption = std::clamp(material.absorption.at(hz) + randomization.noise_std * on_absorption, 0.f, 1.f);
    const float scattering = std::clamp(material.scattering.at(hz) + randomization.noise_std * on_scattering, 0.f, 1.f);
    const float gain = std::pow(10.f, 0.1f * randomization.transmission_noise_db * on_transmission);
    const std::pair<CoefficientCurve*, float> points[] = {{&noisy.absorption, absorption},
                                                          {&noisy.scattering, scattering},
                                                          {&noisy.transmission, std::min(material.transmission.at(hz) * gain, absorption)}};
    for (const auto& [curve, value] : points) {
      curve->hz.push_back(hz);
      curve->value.push_back(value);
    }
  }
  noisy.sources.clear();
  noisy.source = fmt::format("{}; randomized with seed {}", material.source, randomization.seed);
  return noisy;
}

std::vector<Material> randomize_materials(std::string_view scene, std::span<const std::string> slot_names,
                                          std::span<const Material> materials, const SemanticMaterials& semantics,
                                          const MaterialDatabase& database, const AcousticRandomization& randomization) {
  EARSHOT_EXPECT(slot_names.empty() || slot_names.size() == materials.size());
  std::vector<Material> result;
  for (std::size_t slot = 0; slot < materials.size(); ++slot) {
    const Material& original = materials[slot];
    const bool by_name = original.category.empty() && !slot_names.empty();
    const std::string category = by_name ? semantics.category_of(slot_names[slot]) : original.category;
    const std::string key = key_of(category, original);
    const Material* chosen = &original;
    const std::vector<const Material*> candidates = semantics.materials_of(category, database);
    if (randomization.candidates && !candidates.empty()) {
      const auto count = static_cast<std::uint32_t>(candidates.size());
      chosen = candidates[stream_of(randomization.seed, scene, key).below(count, kChoiceDraw)];
    }
    Material& noisy = result.emplace_back(with_noise(*chosen, randomization, scene, key));
    noisy.category = category;
  }
  return result;
}

Scene randomize_materials(const Scene& scene, const SemanticMaterials& semantics, const MaterialDatabase& database,
                          const AcousticRandomization& randomization) {
  std::vector<Material> materials =
      randomize_materials(scene.name(), scene.mesh().material_names, scene.materials(), semantics, database, randomization);
  return Scene(scene.name(), scene.mesh(), std::move(materials), scene.air(), scene.import_report());
}

}  // namespace earshot
