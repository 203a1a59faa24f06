// SPDX-License-Identifier: Apache-2.0
// Panels that end at another surface: ribs of coffers, fronts of balconies, screens.

#include <gtest/gtest.h>

#include "sim/acoustics/paths/panel_reflection.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/panel_structures.h"

namespace earshot {
namespace {

using namespace panel_structures;

double drawn(std::uint32_t index, std::uint32_t draw, double low, double high) {
  return low + (high - low) * RandomStream(55, Purpose::test, index).uniform(draw);
}

/// Levels found over true ones, over drawn structures.
struct Errors {
  double squares = 0, sum_squares = 0;
  int count = 0, within_1_db = 0, sums = 0;
  std::array<double, kOctaves> worst_sum_db{};
  /// Sectors that have three thousandths of the energy of all.
  void add(const SectorEnergy& found, const SectorEnergy& truth, int octaves) {
    for (std::size_t octave = 0; octave < static_cast<std::size_t>(octaves); ++octave) {
      double sum = 0, true_sum = 0;
      for (std::size_t sector = 0; sector < kSectors; ++sector) sum += found[octave][sector], true_sum += truth[octave][sector];
      for (std::size_t sector = 0; sector < kSectors; ++sector) {
        if (!(truth[octave][sector] > 0.003 * true_sum)) continue;
        const double db = std::max(level_db(found[octave][sector] / truth[octave][sector]), -30.0);
        squares += db * db;
        ++count;
        within_1_db += std::abs(db) < 1 ? 1 : 0;
      }
      const double sum_db = level_db(sum / true_sum);
      sum_squares += sum_db * sum_db;
      ++sums;
      worst_sum_db[octave] = std::max(worst_sum_db[octave], std::abs(sum_db));
    }
  }
  [[nodiscard]] double root_db() const { return std::sqrt(squares / count); }
  [[nodiscard]] double root_of_sums_db() const { return std::sqrt(sum_squares / sums); }
  void print(const char* name) const {
    std::printf("%s: %d sectors, root mean square %.2f dB, %.0f %% within 1 dB; sums %.2f dB root mean square, by octave within", name,
                count, root_db(), 100.0 * within_1_db / count, root_of_sums_db());
    for (const double db : worst_sum_db) std::printf(" %.2f", db);
    std::printf(" dB\n");
  }
};

Structure drawn_coffer(std::uint32_t i) {
  const double width_m = drawn(i, 0, 2, 4);
  const int ribs = 3 + static_cast<int>(drawn(i, 1, 0, 3));
  std::vector<double> at_m;
  for (int rib = 0; rib < ribs; ++rib) at_m.push_back(width_m * (static_cast<double>(rib) / (ribs - 1) - 0.5));
  return with_uprights("coffered ceiling", width_m, drawn(i, 2, 0.2, 0.6), at_m, drawn(i, 3, -40, 40));
}
/// at_end: of its floor; seen from both sides.
Structure drawn_front(std::uint32_t i, bool at_end) {
  const double width_m = drawn(i, 0, 2, 4);
  const double at_m = width_m * (at_end ? -0.5 : drawn(i, 4, -0.4, 0.4));
  return with_uprights("balcony front", width_m, drawn(i, 2, 0.5, 1.2), {at_m}, drawn(i, 3, -50, 50));
}

// Sectors beside the images had nothing, and the others up to 10 dB too much.  A factor of 2 is 3 dB: sums of an octave lie within it, and
// within half of it in the mean.  Sectors have 3 dB, root mean square: cells between ribs do not couple.
void expect_near_boundary_elements(int octaves) {
  Errors coffers, fronts, ends;
  for (std::uint32_t i = 0; i < 10; ++i) {
    const Structure coffer = drawn_coffer(i), front = drawn_front(10 + i, false), end = drawn_front(20 + i, true);
    const AcousticScene scene(drawn_out(coffer), config_of(true));
    const auto add = [&](Errors& errors, const Structure& structure) {
      errors.add(scattered_by_engine(structure, true, octaves), by_boundary_elements(structure, scene.bands().centre_hz, octaves), octaves);
    };
    add(coffers, coffer);
    add(fronts, front);
    add(ends, end);
  }
  coffers.print("coffers");
  fronts.print("fronts on a floor");
  ends.print("fronts at the end of a floor");
  for (const Errors* errors : {&coffers, &fronts, &ends}) {
    EXPECT_GT(errors->count, 200);
    EXPECT_LT(errors->root_db(), 3.5);
    EXPECT_LT(errors->root_of_sums_db(), 1.5);
    // Above 252 Hz cells send sound into each other: 4 dB.
    for (std::size_t octave = 0; octave < errors->worst_sum_db.size(); ++octave)
      EXPECT_LT(errors->worst_sum_db[octave], octave < 3 ? 3.0 : 4.0) << octave;
  }
}

TEST(StandingPanels, DrawnStructuresAgainstBoundaryElements) { expect_near_boundary_elements(3); }

TEST(StandingPanels, DrawnStructuresAgainstBoundaryElementsUpTo2Khz) { expect_near_boundary_elements(kOctaves); }

// On an endless floor the field is that of the doubled front in the air from the source and from its image, exactly.  As single strips
// have 0.8 dB, and two are summed here: 1.2 dB, root mean square.  Sums over the half of the sectors that is in front: 2 dB, as at 63 Hz
// the phases of the two are Kirchhoff's.
TEST(StandingPanels, FrontsOnAnEndlessFloorAreDoubledOnes) {
  constexpr int octaves = 4;
  Errors errors;
  for (std::uint32_t i = 40; i < 50; ++i) {
    const double height_m = drawn(i, 0, 0.4, 2), source_deg = drawn(i, 1, 15, 65);
    const Structure front = with_uprights("front", 400, height_m, {0}, source_deg);
    const AcousticScene scene(drawn_out(front), config_of(true));
    const glm::dvec2 s = on_circle(kSourceM, source_deg);
    const EarlyCandidates candidates(scene, glm::vec3(s.x, s.y, 0.013));
    const std::array<rigid_sheets::Sheet, 1> doubled = {rigid_sheets::Sheet{{0, -height_m}, {0, height_m}}};
    const std::array<rigid_sheets::Point, 2> sources = {s, glm::dvec2(s.x, -s.y)};
    SectorEnergy found{}, truth{};
    EnergyResponse response;
    for (int band = 0; band < octaves * kBandsPerOctave; ++band) {
      const double k = 2 * kPi * scene.bands().centre_hz[static_cast<std::size_t>(band)] / scene.speed_of_sound_m_per_s();
      const rigid_sheets::ScatteredField field(doubled, sources, k);
      for (int at = kSectors * kPerSector / 2; at < kSectors * kPerSector; ++at) {  // on the source's side
        const glm::dvec2 r = on_circle(kListenerM, listener_deg(at));
        const auto octave = static_cast<std::size_t>(band / kBandsPerOctave), sector = static_cast<std::size_t>(at / kPerSector);
        truth[octave][sector] += std::norm(field.at(r, 0) + field.at(r, 1)) * 8 * kPi * k * (kSourceM + kListenerM);
        compute_energy_response(scene, candidates, glm::vec3(r.x, r.y, 0.f), response);
        std::complex<double> p = coherent_field::pressure(scene, response.arrivals, static_cast<std::size_t>(band));
        for (const double y : {s.y, -s.y}) {
          const double m = glm::length(glm::dvec3(s.x, y, 0.013) - glm::dvec3(r.x, r.y, 0));
          p -= std::polar(1 / (4 * kPi * m), -k * m);
        }
        found[octave][sector] += std::norm(p) * std::pow(4 * kPi * (kSourceM + kListenerM), 2);
      }
    }
    errors.add(found, truth, octaves);
  }
  errors.print("on an endless floor");
  EXPECT_GT(errors.count, 200);
  EXPECT_LT(errors.root_db(), 1.2);
  for (const double db : errors.worst_sum_db) EXPECT_LT(db, 2.0);
}

// A screen on an endless floor: what it reflects and what it holds back of direct sound and the floor's reflection are one wave of opposite
// signs.  In the middle of wide shadows little is left; low screens hold nothing back.
TEST(StandingPanels, ShadowsGrowWithFrequency) {
  for (std::uint32_t i = 60; i < 70; ++i) {
    const double height_m = drawn(i, 0, 0.5, 0.9), away_m = height_m * drawn(i, 1, 2.5, 3.5);
    const AcousticScene scene(drawn_out(with_uprights("screen", 400, height_m, {0}, 0)), config_of(true));
    // Both see each other over the screen by a little, and the way by the floor passes through the foot of the screen.
    const double over_m = height_m * drawn(i, 2, 1.1, 1.3);
    const EarlyCandidates candidates(scene, glm::vec3(-away_m, over_m, 0.f));
    EnergyResponse response;
    compute_energy_response(scene, candidates, glm::vec3(1.1 * away_m, 1.1 * over_m, 0.1f), response);
    const std::uint64_t floor = path_identity(ArrivalKind::reflection, std::array<std::uint32_t, 1>{0});
    int floors = 0;
    std::array<double, 8> left{};  // pressure of octaves from 63 Hz, over that without the screen
    for (const Arrival& arrival : response.arrivals) {
      if (arrival.identity != floor) continue;
      ++floors;
      for (int band = 0; band < scene.num_bands(); ++band) {
        const double pressure = arrival.amplitude[band] * 4 * kPi * arrival.distance_m;
        EXPECT_LT(pressure, 1.6) << i << " band " << band;  // a zone plate at most
        left[static_cast<std::size_t>(band / kBandsPerOctave)] += pressure / kBandsPerOctave;
      }
    }
    EXPECT_EQ(floors, 1) << i;
    EXPECT_GT(left[0], 0.8) << i;
    EXPECT_LT(left[6], 0.5) << i;
  }
}

/// Two rooms with a wall between them, and a screen in the second one, across the plane in the middle of the first.
std::shared_ptr<const Scene> screen_next_door(double from_m, double to_m, double height_m) {
  TriangleMesh mesh;
  rooms::append_box(mesh, {0, -4, 0}, {13, 8, 3}, 0);  // a floor too wide for a panel
  const auto quad = [&](glm::dvec3 start, glm::dvec3 along, double up_m) {
    const glm::dvec3 end = start + along, up(0, 0, up_m);
    std::array<glm::vec3, 4> corners;
    std::size_t i = 0;
    for (const glm::dvec3 p : {start, end, end + up, start + up}) corners[i++] = rooms::point(p.x, p.y, p.z);
    rooms::append_quad(mesh, corners, 0);
  };
  quad({4, -4, 0}, {0, 12, 0}, 3);
  if (height_m > 0) quad({from_m, 2.5, 0}, {to_m - from_m, 0, 0}, height_m);
  return rooms::scene_of(std::move(mesh), {Material::uniform("rigid", 0.f, 0.f)});
}

TEST(StandingPanels, CastNoShadowsThroughWalls) {
  for (std::uint32_t i = 100; i < 110; ++i) {
    const AcousticScene with(screen_next_door(drawn(i, 0, 4.3, 5), drawn(i, 1, 6, 8), drawn(i, 2, 0.8, 2)), config_of(true));
    const AcousticScene without(screen_next_door(0, 0, 0), config_of(true));
    const glm::vec3 source = rooms::point(drawn(i, 3, 1, 3.8), drawn(i, 4, 0.5, 2), drawn(i, 5, 0.5, 2));
    const glm::vec3 listener = rooms::point(drawn(i, 6, 1, 3.8), drawn(i, 7, 3, 4.5), drawn(i, 8, 0.5, 2));
    const EarlyCandidates candidates(with, source);
    EXPECT_TRUE(candidates.diffraction().has_standing()) << i;
    const auto found = coherent_field::arrivals_of(with, candidates, listener),
               open = coherent_field::arrivals_of(without, source, listener);
    const glm::vec3 below(source.x, -source.y, source.z);
    for (const float distance_m : {glm::length(source - listener), glm::length(below - listener)}) {
      const auto at = [&](const std::vector<Arrival>& arrivals) {
        return std::ranges::find_if(arrivals, [&](const Arrival& arrival) {
          return arrival.kind != ArrivalKind::diffraction && std::abs(arrival.distance_m - distance_m) < 1e-4f;
        });
      };
      const auto one = at(found), other = at(open);
      ASSERT_TRUE(one != found.end() && other != open.end()) << i;
      EXPECT_EQ(one->distance_m, other->distance_m) << i;
      EXPECT_EQ(one->amplitude, other->amplitude) << i;
      EXPECT_EQ(one->phase_rad, other->phase_rad) << i;
    }
  }
}

// A floor within walls has no free edges, whatever stands on it: its images stay as they are in the room without the screen.
TEST(StandingPanels, TheFloorOfARoomIsNoPanel) {
  for (std::uint32_t i = 120; i < 130; ++i) {
    const glm::dvec3 size(drawn(i, 0, 3, 9.5), drawn(i, 1, 3, 9.5), 3);
    TriangleMesh mesh;
    rooms::append_box(mesh, {0, 0, 0}, size, 0);
    const double left = drawn(i, 2, 0.5, 0.4 * size.x), right = drawn(i, 3, 0.6 * size.x, size.x - 0.5), at = 0.5 * size.y;
    const std::array<glm::vec3, 4> screen{rooms::point(left, at, 0), rooms::point(right, at, 0), rooms::point(right, at, 1.6),
                                          rooms::point(left, at, 1.6)};
    rooms::append_quad(mesh, screen, 0);
    const AcousticScene scene(rooms::scene_of(std::move(mesh), {Material::uniform("rigid", 0.f, 0.f)}), config_of(true));
    ASSERT_NE(scene.panel_shapes(), nullptr) << i;
    int standing = 0;
    for (const PanelShape& shape : scene.panel_shapes()->all()) {
      standing += shape.stands() ? 1 : 0;
      // Faces of the box that look outwards are panels in the open.
      const bool is_floor = !shape.stands() && shape.normal.y > 0.9 && std::abs(shape.centre.y) < 0.1;
      EXPECT_FALSE(is_floor) << i;
    }
    EXPECT_EQ(standing, 2) << i;
  }
}

TEST(StandingPanels, SwappedEndsGiveTheSameLevels) {
  // Each end has waves of the panels that it sees: the same on one side of a front; of opposite ends within rounding.
  for (std::uint32_t i = 80; i < 92; ++i) {
    const Structure front = drawn_front(i, false);
    const AcousticScene scene(drawn_out(front), config_of(true));
    const glm::vec3 a(drawn(i, 10, -5, 5), drawn(i, 11, 2, 6), drawn(i, 12, -1, 1)), b(drawn(i, 13, -8, 8), drawn(i, 14, 2, 6), 0.2);
    const auto one = coherent_field::arrivals_of(scene, a, b), other = coherent_field::arrivals_of(scene, b, a);
    ASSERT_EQ(one.size(), other.size()) << i;
    for (std::size_t band = 0; band < static_cast<std::size_t>(scene.num_bands()); ++band) {
      const std::complex<double> p = coherent_field::pressure(scene, one, band), q = coherent_field::pressure(scene, other, band);
      EXPECT_LT(std::abs(p - q), 2e-3 * std::abs(p)) << i << " band " << band;
    }
  }
}

}  // namespace
}  // namespace earshot
