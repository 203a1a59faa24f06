// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/acoustic_randomization.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <map>
#include <numbers>
#include <utility>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/random.h"
#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

constexpr int kOctaves = 9;      // 63 Hz to 16 kHz
constexpr int kMainOctaves = 7;  // 125 Hz to 8 kHz, from the second on

// Draws of one key: the choice; for the octaves from 125 Hz to 8 kHz one pair each for absorption and scattering, then one each for
// transmission; the same for those of 63 Hz and 16 kHz.
constexpr std::uint32_t kChoiceDraw = 0, kSurfaceDraw = 1, kTransmissionDraw = kSurfaceDraw + kMainOctaves,
                        kOuterSurfaceDraw = kTransmissionDraw + kMainOctaves, kOuterTransmissionDraw = kOuterSurfaceDraw + 2;

/// Half of the width of the step between two octaves, as a fraction of the frequency.
constexpr double kStep = 1e-5;

/// Of the base-ten octave: its midband, and its edges at -0.5 and 0.5.
double octave_hz(double octave) { return 1000.0 * std::pow(10.0, 0.3 * (octave - 4)); }

int octave_of(float hz) {
  return std::clamp(static_cast<int>(std::floor(std::log10(static_cast<double>(hz) / 1000) / 0.3 + 4.5)), 0, kOctaves - 1);
}

/// Frequencies of the points of a noisy material: those of its curves, the midbands, and both sides of every edge.
std::vector<float> knots_of(const Material& material) {
  std::vector<float> knots;
  for (int octave = 0; octave < kOctaves; ++octave) knots.push_back(static_cast<float>(octave_hz(octave)));
  for (int edge = 1; edge < kOctaves; ++edge)
    for (const double side : {1 - kStep, 1 + kStep}) knots.push_back(static_cast<float>(octave_hz(edge - 0.5) * side));
  for (const CoefficientCurve* curve : {&material.absorption, &material.scattering, &material.transmission})
    for (const float hz : curve->hz) {
      const int octave = octave_of(hz);
      const bool is_in_step = (octave > 0 && hz < octave_hz(octave - 0.5) * (1 + kStep)) ||
                              (octave + 1 < kOctaves && hz > octave_hz(octave + 0.5) * (1 - kStep));
      if (!is_in_step) knots.push_back(hz);
    }
  std::ranges::sort(knots);
  knots.erase(std::unique(knots.begin(), knots.end()), knots.end());
  return knots;
}

/// Of one octave: standard normal for absorption, scattering and transmission.
using OctaveDraws = std::array<double, 3>;

/// Each of variance 1, and with the correlation that is asked between neighbouring octaves of absorption and of scattering.
std::array<OctaveDraws, kOctaves> draw_octaves(const RandomStream& random, const AcousticRandomization& randomization) {
  // Uniform numbers of a pair of normal ones with the correlation r have (6 / pi) asin(r / 2) (Pearson 1907).
  const auto asked = static_cast<double>(randomization.noise_correlation);
  const double r = randomization.uniform ? 2 * std::sin(std::numbers::pi * asked / 6) : asked, rest = std::sqrt(std::max(0.0, 1 - r * r));
  std::array<OctaveDraws, kOctaves> draws{};
  for (std::uint32_t octave = 0; octave < kOctaves; ++octave) {
    const bool is_main = octave >= 1 && octave <= kMainOctaves;
    const std::uint32_t draw = is_main ? octave - 1 : octave == 0 ? 0 : 1;
    const auto [on_absorption, on_scattering] = random.normal2((is_main ? kSurfaceDraw : kOuterSurfaceDraw) + draw);
    const float on_transmission = random.normal2((is_main ? kTransmissionDraw : kOuterTransmissionDraw) + draw)[0];
    draws[octave] = {static_cast<double>(on_absorption), static_cast<double>(on_scattering), static_cast<double>(on_transmission)};
  }
  // The chain leads up from 125 Hz, and down from there to 63 Hz: of r to the power of the steps between two octaves in any case.
  const auto follow = [&](std::size_t octave, std::size_t before) {
    for (std::size_t i = 0; i < 2; ++i) draws[octave][i] = r * draws[before][i] + rest * draws[octave][i];
  };
  for (std::size_t octave = 2; octave < kOctaves; ++octave) follow(octave, octave - 1);
  follow(0, 1);
  return draws;
}

/// Distribution of the standard normal.
double normal_cdf(double x) { return 0.5 * std::erfc(-x / std::numbers::sqrt2); }

float randomized(float value, double normal, const AcousticRandomization& randomization) {
  if (randomization.uniform) return static_cast<float>(normal_cdf(normal));
  return std::clamp(value + randomization.noise_std * static_cast<float>(normal), 0.f, 1.f);
}

RandomStream stream_of(std::uint64_t seed, std::string_view scene, std::string_view key) {
  const std::uint64_t place = hash64(std::filesystem::path(scene).filename().string());
  return {seed, Purpose::material, static_cast<std::uint32_t>(place), static_cast<std::uint32_t>(place >> 32),
          static_cast<std::uint32_t>(hash64(key))};
}

std::string key_of(const std::string& category, const Material& material) {
  return category.empty() ? "material " + material.name : "category " + category;
}

/// Gives each pair of a slot and an object a slot of its own.  Returns the object of each slot.  report: keeps its entries by slot.
std::vector<std::string> split_by_object(TriangleMesh& mesh, std::vector<Material>& materials, ImportReport& report) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> slots;
  std::vector<std::string> names, objects;
  std::vector<Material> split;
  std::vector<MaterialChoice> choices;
  const bool has_choices = report.choices.size() == materials.size();
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const std::uint32_t slot = mesh.triangle_material[t], object = mesh.triangle_object[t];
    const auto [at, is_added] = slots.emplace(std::pair{slot, object}, static_cast<std::uint32_t>(names.size()));
    if (is_added) {
      objects.push_back(mesh.object_names[object]);
      names.push_back(mesh.material_names[slot] + "/" + objects.back());
      split.push_back(materials[slot]);
      if (has_choices) choices.push_back(report.choices[slot]);
    }
    mesh.triangle_material[t] = at->second;
  }
  mesh.material_names = std::move(names);
  materials = std::move(split);
  report.choices = std::move(choices);
  return objects;
}

/// objects: of each slot; empty: all have the draw of their category.
std::vector<Material> randomize_slots(std::string_view scene, std::span<const std::string> slot_names, std::span<const std::string> objects,
                                      std::span<const Material> materials, const SemanticMaterials& semantics,
                                      const MaterialDatabase& database, const AcousticRandomization& randomization) {
  EARSHOT_EXPECT(slot_names.empty() || slot_names.size() == materials.size());
  std::vector<Material> result;
  for (std::size_t slot = 0; slot < materials.size(); ++slot) {
    const Material& original = materials[slot];
    const bool by_name = original.category.empty() && !slot_names.empty();
    const std::string category = by_name ? semantics.category_of(slot_names[slot]) : original.category;
    const std::string key = (objects.empty() ? "" : "object " + objects[slot] + " ") + key_of(category, original);
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

}  // namespace

void read(ConfigReader& reader, AcousticRandomization& randomization) {
  reader.read("candidates", randomization.candidates,
              "Draws the material of each semantic category from its candidates. false: materials stay, with noise.");
  reader.read_choice<RandomizedUnit>("per", randomization.per, {{"category", RandomizedUnit::category}, {"object", RandomizedUnit::object}},
                                     "What gets one draw. category: all surfaces of a semantic category. object: each object of the mesh.");
  reader.read("uniform", randomization.uniform,
              "Absorption and scattering of each octave from 0 to 1, whatever the material. false: Gaussian noise on them.");
  reader.read("noise_std", randomization.noise_std, Allowed::between(0, 1),
              "Standard deviation of the noise on absorption and scattering in each octave. No effect with uniform.");
  reader.read("noise_correlation", randomization.noise_correlation, Allowed::between(0, 1),
              "Correlation of the noise of neighbouring octaves.");
  reader.read("transmission_noise_db", randomization.transmission_noise_db, Allowed::between(0, 60),
              "Standard deviation of the noise on transmission losses.");
}

Material with_noise(const Material& material, const AcousticRandomization& randomization, std::string_view scene, std::string_view key) {
  const std::array<OctaveDraws, kOctaves> draws = draw_octaves(stream_of(randomization.seed, scene, key), randomization);
  Material noisy = material;
  noisy.absorption = noisy.scattering = noisy.transmission = {};
  // That of the noisy absorption; a measured one stays where absorption does.
  if (randomization.uniform || randomization.noise_std > 0) noisy.impedance_real = noisy.impedance_imaginary = {};
  for (const float hz : knots_of(material)) {
    const auto [on_absorption, on_scattering, on_transmission] = draws[static_cast<std::size_t>(octave_of(hz))];
    const float absorption = randomized(material.absorption.at(hz), on_absorption, randomization);
    const float scattering = randomized(material.scattering.at(hz), on_scattering, randomization);
    const float gain = std::pow(10.f, 0.1f * randomization.transmission_noise_db * static_cast<float>(on_transmission));
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

std::string_view without_object(std::string_view slot, std::string_view object) {
  const bool is_split = slot.size() > object.size() && slot.ends_with(object) && slot[slot.size() - object.size() - 1] == '/';
  return is_split ? slot.substr(0, slot.size() - object.size() - 1) : slot;
}

std::vector<Material> randomize_materials(std::string_view scene, std::span<const std::string> slot_names,
                                          std::span<const Material> materials, const SemanticMaterials& semantics,
                                          const MaterialDatabase& database, const AcousticRandomization& randomization) {
  return randomize_slots(scene, slot_names, {}, materials, semantics, database, randomization);
}

void randomize_materials(std::string_view scene, TriangleMesh& mesh, std::vector<Material>& materials, ImportReport& report,
                         bool use_slot_names, const SemanticMaterials& semantics, const MaterialDatabase& database,
                         const AcousticRandomization& randomization) {
  // Categories are those of the names before a slot is split.
  if (use_slot_names)
    for (std::size_t slot = 0; slot < materials.size(); ++slot)
      if (materials[slot].category.empty()) materials[slot].category = semantics.category_of(mesh.material_names[slot]);
  std::vector<std::string> objects;
  if (randomization.per == RandomizedUnit::object) objects = split_by_object(mesh, materials, report);
  materials = randomize_slots(scene, {}, objects, materials, semantics, database, randomization);
}

Scene randomize_materials(const Scene& scene, const SemanticMaterials& semantics, const MaterialDatabase& database,
                          const AcousticRandomization& randomization) {
  TriangleMesh mesh = scene.mesh();
  std::vector<Material> materials = scene.materials();
  ImportReport report = scene.import_report();
  randomize_materials(scene.name(), mesh, materials, report, true, semantics, database, randomization);
  return Scene(scene.name(), std::move(mesh), std::move(materials), scene.air(), std::move(report));
}

}  // namespace earshot
