// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "sim/acoustics/response/energy_response.h"
#include "tests/support/acoustics/coherent_field.h"
#include "tests/support/acoustics/rigid_sheets.h"
#include "tests/support/acoustics/rooms.h"

/// Energy that structures of thin rigid sheets reflect into sectors of 15 degrees, by boundary elements in two dimensions and by the engine
/// with the same sheets drawn out to 120 m.  Source and listeners are kSourceM and kListenerM from the middle of the structure.
namespace earshot::panel_structures {

inline constexpr double kSourceM = 17, kListenerM = 12;
inline constexpr int kSectors = 12, kPerSector = 3, kOctaves = 6, kBandsPerOctave = 4;
inline constexpr double kPi = std::numbers::pi;

struct Structure {
  std::string name;
  std::vector<rigid_sheets::Sheet> sheets;
  double source_deg;  ///< from the vertical
};

/// By octave from 63 Hz and sector from -90 degrees, relative to the image in an endless plane.
using SectorEnergy = std::array<std::array<double, kSectors>, kOctaves>;

inline glm::dvec2 on_circle(double radius_m, double degrees) {
  return {radius_m * std::sin(degrees * kPi / 180), radius_m * std::cos(degrees * kPi / 180)};
}
inline double listener_deg(int i) { return -90 + (i + 0.5) * 15.0 / kPerSector; }

inline AcousticConfig config_of(bool all_edges) {
  AcousticConfig config = coherent_field::config_with(all_edges ? Switch::on : Switch::automatic);
  if (!all_edges) config.rays = 64;
  config.bands = kMaxBands;
  config.late = Switch::off;
  return config;
}

/// Bands 0 to 3 of the engine are the octave of 63 Hz.
inline SectorEnergy by_boundary_elements(const Structure& structure, std::span<const float> centre_hz, int octaves, double speed = 343) {
  SectorEnergy energy{};
  const std::array<rigid_sheets::Point, 1> source = {on_circle(kSourceM, structure.source_deg)};
  for (int band = 0; band < octaves * kBandsPerOctave; ++band) {
    const double k = 2 * kPi * centre_hz[static_cast<std::size_t>(band)] / speed;
    const rigid_sheets::ScatteredField field(structure.sheets, source, k);
    const double image = 1 / (8 * kPi * k * (kSourceM + kListenerM));
    for (int i = 0; i < kSectors * kPerSector; ++i)
      energy[static_cast<std::size_t>(band / kBandsPerOctave)][static_cast<std::size_t>(i / kPerSector)] +=
          std::norm(field.at(on_circle(kListenerM, listener_deg(i)))) / image / kPerSector / kBandsPerOctave;
  }
  return energy;
}

inline std::shared_ptr<const Scene> drawn_out(const Structure& structure) {
  TriangleMesh mesh;
  for (const rigid_sheets::Sheet& sheet : structure.sheets)
    for (std::size_t i = 0; i + 1 < sheet.size(); ++i) {
      const glm::vec3 a(sheet[i].x, sheet[i].y, 0), b(sheet[i + 1].x, sheet[i + 1].y, 0), half(0, 0, 60);
      rooms::append_quad(mesh, {a - half, a + half, b + half, b - half}, 0);
    }
  return rooms::scene_of(std::move(mesh), {Material::uniform("rigid", 0.f, 0.f)});
}

/// Energy at the listeners of all sectors, over that of an image.  coherent: pressure that is left of a response in a band, with its phase;
/// what joins the late field is added.
template <class Coherent>
SectorEnergy over_sectors(const Structure& structure, bool all_edges, int octaves, Coherent coherent) {
  const AcousticScene scene(drawn_out(structure), config_of(all_edges));
  const glm::dvec2 s = on_circle(kSourceM, structure.source_deg);
  const EarlyCandidates candidates(scene, glm::vec3(s.x, s.y, 0.013));
  SectorEnergy energy{};
  EnergyResponse response;
  for (int i = 0; i < kSectors * kPerSector; ++i) {
    const glm::dvec2 r = on_circle(kListenerM, listener_deg(i));
    const glm::vec3 listener(r.x, r.y, 0.f);
    compute_energy_response(scene, candidates, listener, response);
    const double straight_m = glm::length(glm::dvec3(candidates.source()) - glm::dvec3(listener));
    for (int band = 0; band < octaves * kBandsPerOctave; ++band) {
      double sum = std::norm(coherent(scene, response, straight_m, static_cast<std::size_t>(band)));
      for (const Arrival& arrival : response.scattered) sum += double{arrival.amplitude[band]} * arrival.amplitude[band];
      energy[static_cast<std::size_t>(band / kBandsPerOctave)][static_cast<std::size_t>(i / kPerSector)] +=
          sum * std::pow(4 * kPi * (kSourceM + kListenerM), 2) / kPerSector / kBandsPerOctave;
    }
  }
  return energy;
}

/// All paths but the direct sound, with their phases, and the energy that joins the late field.
inline SectorEnergy by_engine(const Structure& structure, bool all_edges, int octaves) {
  return over_sectors(structure, all_edges, octaves, [](const AcousticScene& scene, EnergyResponse& response, double, std::size_t band) {
    std::erase_if(response.arrivals, [](const Arrival& arrival) { return arrival.kind == ArrivalKind::direct; });
    return coherent_field::pressure(scene, response.arrivals, band);
  });
}

/// All paths less the free field of the source, with their phases, and the energy that joins the late field: what a structure scatters, its
/// shadow too.
inline SectorEnergy scattered_by_engine(const Structure& structure, bool all_edges, int octaves) {
  return over_sectors(structure, all_edges, octaves,
                      [](const AcousticScene& scene, const EnergyResponse& response, double straight_m, std::size_t band) {
                        const double k = 2 * kPi * scene.bands().centre_hz[band] / scene.speed_of_sound_m_per_s();
                        const std::complex<double> incident = std::polar(1 / (4 * kPi * straight_m), -k * straight_m);
                        return coherent_field::pressure(scene, response.arrivals, band) - incident;
                      });
}

/// A sheet of this width about the origin with others of a height upright on it; corners where they meet.
inline Structure with_uprights(std::string name, double width_m, double height_m, const std::vector<double>& at_m, double source_deg) {
  Structure structure{std::move(name), {{{-0.5 * width_m, 0}}}, source_deg};
  for (const double x : at_m)
    if (std::abs(x) < 0.5 * width_m - 1e-6) structure.sheets[0].push_back({x, 0});
  structure.sheets[0].push_back({0.5 * width_m, 0});
  for (const double x : at_m) structure.sheets.push_back({{x, 0}, {x, height_m}});
  return structure;
}

/// Is a whole sector in front of all sheets, as the source is?
inline bool in_front(const Structure& structure, int sector) {
  for (const rigid_sheets::Sheet& sheet : structure.sheets)
    for (const double edge : {0.0, 15.0}) {
      const glm::dvec2 along = sheet.back() - sheet.front(), from = on_circle(kListenerM, -90 + 15.0 * sector + edge) - sheet.front();
      if (along.x * from.y - along.y * from.x < -1e-9) return false;
    }
  return true;
}

inline double level_db(double energy) { return 10 * std::log10(std::max(energy, 1e-12)); }

/// Errors in dB, one line an octave; the last number is the error of the sum over the sectors.
inline void print_errors(const char* title, const SectorEnergy& found, const SectorEnergy& truth, int octaves) {
  std::printf("%s\n", title);
  for (std::size_t octave = 0; octave < static_cast<std::size_t>(octaves); ++octave) {
    double sum = 0, true_sum = 0;
    std::printf("  %5d Hz", 63 << octave);
    for (std::size_t sector = 0; sector < kSectors; ++sector) {
      std::printf(" %5.1f", std::max(level_db(found[octave][sector] / truth[octave][sector]), -99.0));
      sum += found[octave][sector];
      true_sum += truth[octave][sector];
    }
    std::printf("  | %5.1f\n", level_db(sum / true_sum));
  }
}

inline std::vector<Structure> known_structures() {
  const auto tilted = [](double x, double y, double width, double degrees) {
    const glm::dvec2 half(0.5 * width * std::cos(degrees * kPi / 180), 0.5 * width * std::sin(degrees * kPi / 180));
    return rigid_sheets::Sheet{glm::dvec2(x, y) - half, glm::dvec2(x, y) + half};
  };
  std::vector<Structure> structures;
  for (const double width : {0.5, 1.0, 2.0, 4.0})
    structures.push_back({"strip of " + std::to_string(width).substr(0, 3) + " m", {tilted(0, 0, width, 0)}, 30});
  structures.push_back({"array of three panels", {tilted(-1.4, 0.1, 1.0, -8), tilted(0, 0, 1.0, 0), tilted(1.4, 0.1, 1.0, 8)}, 20});
  structures.push_back(
      {"coffered ceiling",
       {tilted(0, 0, 4, 0), {{-2, 0}, {-2, 0.4}}, {{-0.67, 0}, {-0.67, 0.4}}, {{0.67, 0}, {0.67, 0.4}}, {{2, 0}, {2, 0.4}}},
       25});
  structures.push_back({"balcony front", {{{-0.9, 0}, {-0.9, 1.0}}, {{-0.9, 0}, {1.1, 0}}}, -50});
  return structures;
}

}  // namespace earshot::panel_structures
