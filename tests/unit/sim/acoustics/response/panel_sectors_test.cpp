// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "sim/acoustics/paths/panel_reflection.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/panel_structures.h"

/// Energy that panels reflect to each side, against boundary elements.
namespace earshot {
namespace {

using namespace panel_structures;

double drawn(std::uint32_t index, std::uint32_t draw, double low, double high) {
  return low + (high - low) * RandomStream(38, Purpose::test, index).uniform(draw);
}

/// Errors of the sectors of one octave.
struct Errors {
  double squares = 0;
  std::array<double, kOctaves> worst_sum_db{};
  int count = 0, within_1_db = 0;
  /// Sectors in front of all sheets, that have a fraction of the energy.
  void add(const Structure& structure, const SectorEnergy& found, const SectorEnergy& truth, int octaves, double least_fraction) {
    for (std::size_t octave = 0; octave < static_cast<std::size_t>(octaves); ++octave) {
      double sum = 0, true_sum = 0;
      for (const double e : truth[octave]) true_sum += e;
      for (std::size_t sector = 0; sector < kSectors; ++sector) {
        sum += found[octave][sector];
        if (truth[octave][sector] < least_fraction * true_sum || !in_front(structure, static_cast<int>(sector))) continue;
        const double db = level_db(found[octave][sector] / truth[octave][sector]);
        squares += db * db;
        ++count;
        within_1_db += std::abs(db) < 1 ? 1 : 0;
      }
      worst_sum_db[octave] = std::max(worst_sum_db[octave], std::abs(level_db(sum / true_sum)));
    }
  }
  [[nodiscard]] double root_db() const { return std::sqrt(squares / count); }
  void print(const char* name) const {
    std::printf("%s: %d sectors, root mean square %.2f dB, %.0f %% within 1 dB, sums by octave within", name, count, root_db(),
                100.0 * within_1_db / count);
    for (const double db : worst_sum_db) std::printf(" %.2f", db);
    std::printf(" dB\n");
  }
};

void expect_within_1_db(int octaves) {
  // The bound of a sector is 1 dB, root mean square, and 1.2 dB for an octave's sum: a factor of 2 is 3 dB, and the image with what is left
  // of it as late energy was 12 dB too much.
  Errors strips, arrays;
  for (std::uint32_t i = 0; i < 10; ++i) {
    const double width_m = drawn(i, 0, 0.5, 4), tilt = drawn(i, 1, -25, 25) * kPi / 180;
    const glm::dvec2 half = 0.5 * width_m * glm::dvec2(std::cos(tilt), std::sin(tilt));
    const Structure strip{"strip", {{-half, half}}, drawn(i, 2, -40, 40)};
    const AcousticScene scene(drawn_out(strip), config_of(true));
    const SectorEnergy truth = by_boundary_elements(strip, scene.bands().centre_hz, octaves);
    for (const bool all_edges : {false, true}) strips.add(strip, by_engine(strip, all_edges, octaves), truth, octaves, 0.003);
  }
  for (std::uint32_t i = 10; i < 16; ++i) {
    Structure array{"array", {}, drawn(i, 0, -30, 30)};
    for (const double at_m : {-1.4, 0.0, 1.4}) {
      const auto draw = static_cast<std::uint32_t>(std::lround(at_m / 1.4) + 2);
      const double tilt = drawn(i, draw, -15, 15) * kPi / 180, half_m = drawn(i, draw + 4, 0.3, 0.6);
      const glm::dvec2 middle(at_m, drawn(i, draw + 8, -0.2, 0.2)), half = half_m * glm::dvec2(std::cos(tilt), std::sin(tilt));
      array.sheets.push_back({middle - half, middle + half});
    }
    const AcousticScene scene(drawn_out(array), config_of(true));
    arrays.add(array, by_engine(array, false, octaves), by_boundary_elements(array, scene.bands().centre_hz, octaves), octaves, 0.01);
  }
  strips.print("strips");
  arrays.print("arrays");
  EXPECT_GT(strips.count, 400);
  EXPECT_LT(strips.root_db(), 1.0);
  EXPECT_LT(arrays.root_db(), 1.5);  // panels do not see each other, which matters most at 63 and 125 Hz
  for (std::size_t octave = 0; octave < kOctaves; ++octave) {
    EXPECT_LT(strips.worst_sum_db[octave], 1.2);
    EXPECT_LT(arrays.worst_sum_db[octave], octave < 2 ? 2.4 : 1.2);
  }
}

TEST(PanelSectors, DrawnPanelsAgainstBoundaryElements) { expect_within_1_db(3); }

TEST(PanelSectors, DrawnPanelsAgainstBoundaryElementsUpTo2Khz) { expect_within_1_db(kOctaves); }

TEST(PanelSectors, TableOfStructures) {
  for (const Structure& structure : known_structures()) {
    const AcousticScene scene(drawn_out(structure), config_of(true));
    const SectorEnergy truth = by_boundary_elements(structure, scene.bands().centre_hz, kOctaves);
    std::printf("%s: levels of the sectors\n", structure.name.c_str());
    for (const auto& octave : truth) {
      for (const double e : octave) std::printf(" %5.1f", level_db(e));
      std::printf("\n");
    }
    const SectorEnergy all = by_engine(structure, true, kOctaves), few = by_engine(structure, false, kOctaves);
    print_errors(" all edges", all, truth, kOctaves);
    print_errors(" few edges", few, truth, kOctaves);
    // Sums over the sectors as for the drawn ones: 1.2 dB, of several panels 2.4 dB.  Of panels that stand on another 4 dB: the one of the
    // balcony front has 3.6 dB at 1 kHz (docs/evidence/validation.md).
    const bool is_strip = structure.sheets.size() == 1 && structure.sheets[0].size() == 2, is_array = structure.sheets.size() == 3;
    for (const SectorEnergy& found : {all, few})
      for (std::size_t octave = 0; octave < kOctaves; ++octave) {
        double sum = 0, true_sum = 0;
        for (std::size_t sector = 0; sector < kSectors; ++sector) sum += found[octave][sector], true_sum += truth[octave][sector];
        EXPECT_NEAR(level_db(sum / true_sum), 0, is_strip ? 1.2 : (is_array ? 2.4 : 4.0)) << structure.name << ", octave " << octave;
      }
  }
}

/// Energy that a panel sends to all sides in front of it, over what falls on it, at one frequency: an integral over the hemisphere.
double energy_to_all_sides(const PanelShape& panel, glm::dvec3 source, double wavenumber) {
  std::array<double, kLanes> same;
  same.fill(wavenumber);
  const WaveLanes wave(same);
  const double far_m = 60;
  double sum = 0;
  constexpr int rings = 60, steps = 180;
  for (int ring = 0; ring < rings; ++ring)
    for (int step = 0; step < steps; ++step) {
      const double height = (ring + 0.5) / rings, around = (step + 0.5) * 2 * kPi / steps, flat = std::sqrt(1 - height * height);
      const glm::dvec3 listener =
          panel.centre + far_m * (height * panel.normal + flat * (std::cos(around) * panel.axis[0] + std::sin(around) * panel.axis[1]));
      const PanelWave path(panel, source, listener);
      sum += double{path.factor(wave).energy[0]} / std::pow(4 * kPi * path.image_m(), 2) * far_m * far_m * 2 * kPi / (rings * steps);
    }
  const glm::dvec3 way = source - panel.centre;
  const double r = glm::length(way), falling = panel.area_m2() * glm::dot(way, panel.normal) / r / std::pow(4 * kPi * r, 2);
  return sum / falling;
}

TEST(PanelSectors, WhatFallsOnAPanelIsReflectedOrPassesRoundIt) {
  // Drawn plates: from small to large against the wave the energy to all sides goes from nothing to what falls on the plate.  It may be
  // a little above it at resonance, as that of the exact strip (1.2) and of the exact square (1.1).
  for (std::uint32_t i = 0; i < 10; ++i) {
    PanelShape panel;
    panel.normal = {0, 1, 0};
    panel.axis = {glm::dvec3(1, 0, 0), glm::dvec3(0, 0, 1)};
    panel.half_side_m = {drawn(i, 0, 0.25, 0.6), drawn(i, 1, 0.25, 0.6)};
    panel.is_sheet = true;
    const double shorter = std::min(panel.half_side_m[0], panel.half_side_m[1]),
                 longer = std::max(panel.half_side_m[0], panel.half_side_m[1]);
    panel.low_ratio_m = 0.25 * kPi * shorter / (1 + (0.5 * kPi - 1) * std::pow(shorter / longer, 1.5));
    const double slope = drawn(i, 2, 0, 0.6);
    const glm::dvec3 source = 40.0 * glm::dvec3(std::sin(slope), std::cos(slope), 0.1);
    double last = 0;
    for (const double waves : {0.1, 0.25, 0.5, 1.0, 2.0, 4.0}) {  // of the shorter side
      const double k = 2 * kPi * waves / (2 * shorter), reflected = energy_to_all_sides(panel, source, k);
      std::printf("plate %u, %.2f waves: %.4f\n", i, waves, reflected);
      if (waves <= 0.25) {
        EXPECT_LT(reflected, 0.2);
      }
      if (waves >= 2) {
        EXPECT_NEAR(reflected, 1, 0.12);  // 0.5 dB
      }
      EXPECT_LT(reflected, 1.35);
      if (waves <= 0.5) {
        EXPECT_GT(reflected, last);
      }
      last = reflected;
    }
  }
}

TEST(PanelSectors, SwappedEndsGiveTheSameBits) {
  for (std::uint32_t i = 0; i < 12; ++i) {
    const Structure strip{"strip", {{{-drawn(i, 0, 0.3, 1), 0}, {drawn(i, 1, 0.3, 1), 0}}}, 0};
    const AcousticScene scene(drawn_out(strip), config_of(true));
    const glm::vec3 a(drawn(i, 2, -5, 5), drawn(i, 3, 2, 6), drawn(i, 4, -1, 1)), b(drawn(i, 5, -8, 8), drawn(i, 6, 2, 6), 0.2);
    const auto one = coherent_field::arrivals_of(scene, a, b), other = coherent_field::arrivals_of(scene, b, a);
    ASSERT_EQ(one.size(), other.size());
    for (std::size_t n = 0; n < one.size(); ++n) {
      EXPECT_EQ(one[n].distance_m, other[n].distance_m);
      EXPECT_EQ(one[n].amplitude, other[n].amplitude);
      EXPECT_EQ(one[n].phase_rad, other[n].phase_rad);
    }
  }
}

TEST(PanelSectors, NoStepWhereTheImageEnds) {
  // A listener that passes the end of the image: the image path becomes a wave to the side, of the same level.
  const Structure strip{"strip", {{{-0.6, 0}, {0.6, 0}}}, 0};
  const AcousticScene scene(drawn_out(strip), config_of(false));
  const EarlyCandidates candidates(scene, glm::vec3(-1, 4, 0.1f));
  std::vector<double> last;
  bool ended = false;
  for (double x = 1.0; x < 4.0; x += 0.002) {
    auto arrivals = coherent_field::arrivals_of(scene, candidates, {static_cast<float>(x), 3.f, 0.f});
    std::erase_if(arrivals, [](const Arrival& path) { return path.kind == ArrivalKind::direct; });
    ASSERT_EQ(arrivals.size(), 1u) << x;
    ended = ended || arrivals[0].kind == ArrivalKind::diffraction;
    std::vector<double> level;
    for (int band = 0; band < scene.num_bands(); ++band) level.push_back(level_db(arrivals[0].amplitude[band]) * 2);
    for (std::size_t band = 0; band < last.size(); ++band) EXPECT_NEAR(level[band], last[band], 0.25) << x << " band " << band;
    last = level;
  }
  EXPECT_TRUE(ended);
}

}  // namespace
}  // namespace earshot
