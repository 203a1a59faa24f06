// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/response/late_edges.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <complex>
#include <cstdio>
#include <numbers>
#include <vector>

#include "sim/acoustics/model/air_points.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/effect_scenes.h"
#include "tests/support/acoustics/finite_wedge.h"

namespace earshot {
namespace {

using rooms::point;

AcousticConfig all_edges() {
  AcousticConfig config;
  config.diffraction = Switch::on;
  config.air_absorption = Switch::off;
  config.rir_length_s = 0.5f;
  return config;
}

glm::vec3 drawn_place(std::uint32_t number, std::uint32_t which, double x0, double x1) {
  const RandomStream random(383, Purpose::test, number, which);
  const auto draw = [&](std::uint32_t i, double low, double high) { return low + (high - low) * double{random.uniform(i)}; };
  return rooms::point(draw(0, x0, x1), draw(1, 0.5, 3.5), draw(2, 0.5, 2.0));
}

TEST(LateEdges, NothingInConvexRoomsOrWithoutDiffraction) {
  for (std::uint32_t number = 0; number < 10; ++number) {
    const AcousticScene box(rooms::shoe1(0.2, 0.3), all_edges());
    for (const double x : late_edges(box, drawn_place(number, 0, 0.5, 4.5), drawn_place(number, 1, 0.5, 4.5)).fraction) EXPECT_EQ(x, 0);
    AcousticConfig off = all_edges();
    off.diffraction = Switch::off;
    const AcousticScene divided(effects::two_rooms(8, 4, 3, 0.9, effects::material(0.2, 0.5), effects::material(0.2, 0.5)), off);
    for (const double x : late_edges(divided, drawn_place(number, 0, 0.5, 3.5), drawn_place(number, 1, 4.5, 7.5)).fraction) EXPECT_EQ(x, 0);
  }
}

/// Two rooms with a door, source in one and listener in the other.
struct Doors {
  AcousticScene scene;
  explicit Doors(double door_m)
      : scene(effects::two_rooms(8, 4, 3, door_m, effects::material(0.2, 0.7), effects::material(0.2, 0.7)), all_edges()) {}
};

// The shadow that an edge fills is sqrt(2 / (k r)) wide: from 126 Hz to 6.7 kHz 7.3 times narrower.  Energies that fall faster, further
// behind the edge, as 1 / k, would give 53; the terms of an edge lie between.  A lost root or square would leave that range.
TEST(LateEdges, NarrowsWithTheRootOfTheWavelength) {
  const Doors doors(0.9);
  double low = 0, high = 0;
  for (std::uint32_t number = 0; number < 10; ++number) {
    const LateEdges edges = late_edges(doors.scene, drawn_place(number, 0, 0.5, 3.5), drawn_place(number, 1, 4.5, 7.5));
    for (std::size_t band = 1; band < edges.fraction.size(); ++band)
      EXPECT_LT(edges.fraction[band], 1.1 * edges.fraction[band - 1]) << number;
    low += edges.fraction.front(), high += edges.fraction.back();
  }
  const double ratio = double{doors.scene.bands().centre_hz.back()} / double{doors.scene.bands().centre_hz.front()};
  EXPECT_GT(low / high, 0.8 * std::sqrt(ratio));
  EXPECT_LT(low / high, 1.2 * ratio);
}

TEST(LateEdges, SourceAndListenerSwap) {
  const Doors doors(0.9);
  double sum = 0;
  for (std::uint32_t number = 0; number < 10; ++number) {
    const glm::vec3 a = drawn_place(number, 0, 0.5, 3.5), b = drawn_place(number, 1, 4.5, 7.5);
    const LateEdges there = late_edges(doors.scene, a, b), back = late_edges(doors.scene, b, a);
    // Two estimates of one number, each with a standard error of about a tenth to a sixth.
    EXPECT_NEAR(back.fraction[0] / there.fraction[0], 1, 0.8) << number;
    sum += std::log(back.fraction[0] / there.fraction[0]);
  }
  // Of ten pairs: a standard error of about 0.2 / sqrt(10) = 0.07.
  EXPECT_NEAR(sum / 10, 0, 0.25);
}

// Behind a screen in the open, with a wall on the side of the source: nothing of what that wall sends back gets to the listener but round
// the edge of the screen.
TEST(LateEdges, IsAllThereIsWhereRaysBringNothing) {
  for (std::uint32_t number = 0; number < 10; ++number) {
    const RandomStream random(384, Purpose::test, number);
    const double height_m = 2 + double{random.uniform(0)}, behind_m = 1 + 2 * double{random.uniform(1)};
    TriangleMesh mesh;
    rooms::append_quad(
        mesh, {rooms::point(0, -30, -30), rooms::point(0, 30, -30), rooms::point(0, 30, height_m), rooms::point(0, -30, height_m)}, 0);
    rooms::append_quad(mesh, {rooms::point(-4, -3, 0), rooms::point(-4, 3, 0), rooms::point(-4, 3, 1.5), rooms::point(-4, -3, 1.5)}, 0);
    AcousticConfig config = all_edges();
    config.late = Switch::on;
    const AcousticScene scene(rooms::scene_of(std::move(mesh), {effects::material(0.2, 1)}), config);
    const LateEdges edges = late_edges(scene, rooms::point(-2, 0, 1), rooms::point(behind_m, 0, 1));
    for (const double x : edges.fraction) EXPECT_TRUE(std::isinf(x)) << number << " " << x;
  }
}

// The walks of a directional source see the listener from a small panel before it; those of the listener meet the back of a screen and a
// wall behind it, and never the panel, a 10,000th of their sphere.  What goes round the screen to the source is then of no known fraction.
TEST(LateEdges, OfADirectionalSourceIsAllThereIsWhereNothingComesBack) {
  for (std::uint32_t number = 0; number < 10; ++number) {
    const RandomStream random(515, Purpose::test, number);
    const double away_m = 20 + 5 * double{random.uniform(0)}, aside_m = 0.9 + 0.3 * double{random.uniform(1)};
    TriangleMesh mesh;
    const auto panel = [&](double x, double y0, double y1, double z) {
      rooms::append_quad(mesh, {rooms::point(x, y0, -z), rooms::point(x, y1, -z), rooms::point(x, y1, z), rooms::point(x, y0, z)}, 0);
    };
    panel(0.3, -0.2, 0.2, 0.2);
    panel(-away_m + 0.5, -2, 0.4, 2);
    panel(-away_m - 1, -1.5, 0.3, 1.5);
    AcousticConfig config = all_edges();
    config.late = Switch::on;
    const AcousticScene scene(rooms::scene_of(std::move(mesh), {effects::material(0.2, 1)}), config);
    SoundSource source(rooms::point(0, 0, 0));
    source.directivity = Directivity::first_order(0.5f);
    source.orientation = glm::quat(glm::vec3(0, 0, -1), rooms::point(1, 0, 0));
    const LateEdges edges = late_edges(scene, source, rooms::point(-away_m, aside_m, 0));
    for (const double x : edges.fraction) EXPECT_TRUE(std::isinf(x)) << number << " " << x;
    for (const double db : edges.change_db()) EXPECT_TRUE(std::isinf(db)) << number << " " << db;
  }
}

/// A black screen without end below its top edge at x = 0, z = 0, a diffuse panel at x = -away_m, the source between them below the edge
/// and the listener behind the screen above it.  Late sound is what the panel sends back once: the part of it that the listener sees, and
/// round the edge the rest.
struct Screen {
  static constexpr double kHalfM = 6;  ///< of the panel
  double away_m;
  glm::dvec3 source, listener;

  explicit Screen(std::uint32_t number) {
    const RandomStream random(563, Purpose::test, number);
    const auto draw = [&](std::uint32_t i, double low, double high) { return low + (high - low) * double{random.uniform(i)}; };
    away_m = draw(0, 2.5, 4);
    source = {-away_m * draw(1, 0.35, 0.65), draw(2, -1, 1), draw(3, -1.5, -0.3)};
    listener = {draw(4, 1, 2), draw(5, -1, 1), draw(6, 0.2, 1)};
  }
  [[nodiscard]] AcousticScene scene() const {
    TriangleMesh mesh;
    rooms::append_quad(mesh, {point(0, -40, -40), point(0, 40, -40), point(0, 40, 0), point(0, -40, 0)}, 0);
    rooms::append_quad(mesh,
                       {point(-away_m, -kHalfM, -kHalfM), point(-away_m, kHalfM, -kHalfM), point(-away_m, kHalfM, kHalfM),
                        point(-away_m, -kHalfM, kHalfM)},
                       1);
    AcousticConfig config = all_edges();
    config.late = Switch::on;
    return {rooms::scene_of(std::move(mesh), {effects::material(1, 0), effects::material(0.2, 1)}), config};
  }
  /// The mean of late_edges() over seeds.  By Lambert's law over the panel, the field round the edge as that of a half plane; times what
  /// the mean of a ratio of few walks is above the ratio of the means, to the second order of their spread.
  [[nodiscard]] double fraction(double wavenumber) const {
    constexpr int rows = 60, columns = 120;
    constexpr double walks = kLateEdgeWalks, whole = 4 * std::numbers::pi;
    const double shadow_m = -listener.z * away_m / listener.x;  // the panel is seen from this height on
    const auto about_edge = [](const glm::dvec3& at) {
      const double angle = std::atan2(-at.x, -at.z);  // from the side of the source, which looks down along -z
      return finite_wedge::Point{std::hypot(at.x, at.z), angle < 0 ? angle + 2 * std::numbers::pi : angle, at.y};
    };
    double straight = 0, squares_here = 0, squares_there = 0, round_edge = 0;  // of one walk: means, and mean squares from either end
    for (int row = -rows; row < rows; ++row)
      for (int column = 0; column < columns; ++column) {
        // Rows are finer toward the shadow boundary, where the field round the edge falls fast.
        const double to_end_m = row < 0 ? -kHalfM - shadow_m : kHalfM - shadow_m, part = std::abs(row + 0.5) / rows;
        const glm::dvec3 at(-away_m, -kHalfM + 2 * kHalfM * (column + 0.5) / columns, shadow_m + to_end_m * part * part);
        const double cell_m2 = 2 * kHalfM / columns * 2 * part * std::abs(to_end_m) / rows;
        const double from_m = glm::length(at - source), to_m = glm::length(listener - at);
        const double falls_here = cell_m2 / whole * (source.x + away_m) / std::pow(from_m, 3),
                     falls_there = cell_m2 / whole * (listener.x + away_m) / std::pow(to_m, 3);
        if (row >= 0) {
          const double seen_here = (listener.x + away_m) / to_m / std::pow(whole * to_m, 2),
                       seen_there = (source.x + away_m) / from_m / std::pow(whole * from_m, 2);
          straight += falls_here * seen_here;  // the same from the other end: reciprocity
          squares_here += falls_here * seen_here * seen_here, squares_there += falls_there * seen_there * seen_there;
        } else {
          // Sound leaves for the point of the edge that the shortest way goes by.
          const finite_wedge::Point here = about_edge(at), there = about_edge(listener);
          const double by = here.z + (there.z - here.z) * here.r / (here.r + there.r);
          const double cosine = away_m / std::hypot(away_m, at.z, by - at.y);
          round_edge += falls_here * cosine * std::norm(finite_wedge::half_plane(here, there, wavenumber, 0));
        }
      }
    const double spread = (squares_here + squares_there - 2 * straight * straight) / (4 * walks * straight * straight);
    return round_edge / straight * (1 + spread + 1 / (2 * walks));  // the last: a walk that sees the listener goes round no edge
  }
};

TEST(LateEdges, TheReferenceIsTheLineIntegral) {
  for (std::uint32_t number = 0; number < 10; ++number) {
    const RandomStream random(564, Purpose::test, number);
    const auto draw = [&](std::uint32_t i, double low, double high) { return low + (high - low) * double{random.uniform(i)}; };
    const finite_wedge::Point source{draw(0, 0.5, 3), draw(1, 0.3, 2.8), draw(2, -1, 1)},
        listener{draw(3, 0.5, 3), source.angle_rad + std::numbers::pi * draw(4, 1.05, 1.1), 0};
    const double wavenumber = draw(5, 2, 12);
    const std::complex<double> whole = finite_wedge::half_plane(source, listener, wavenumber, 1),
                               line = finite_wedge::line_integral(2 * std::numbers::pi, source, listener, -60, 60, wavenumber);
    // The ends of the line send waves of their own, k r^2 / l weaker.
    EXPECT_LT(std::abs(whole - line), 0.02 * std::abs(line)) << number;
  }
}

// Means over seeds: 48 walks have a standard error of 0.8 of the fraction, the mean of 128 one of 7 %.  The theory of edges is within 5 %,
// and so is what the third order of the spread leaves: tolerance 25 % of one setting and 12 % of the mean of ten.
TEST(LateEdges, IsTheFieldOfAHalfPlaneOverADiffusePanel) {
  constexpr int seeds = 128;
  constexpr std::array<std::size_t, 3> bands = {1, 3, 5};
  std::array<double, bands.size()> mean{};
  for (std::uint32_t number = 0; number < 10; ++number) {
    const Screen screen(number);
    const AcousticScene first = screen.scene();
    const auto at = [](const glm::dvec3& p) { return point(p.x, p.y, p.z); };
    std::array<double, bands.size()> found{};
    for (int seed = 1; seed <= seeds; ++seed) {
      const AcousticScene scene = first.with_rays(first.config().rays, static_cast<std::uint64_t>(seed));
      const LateEdges edges = late_edges(scene, at(screen.source), at(screen.listener));
      for (std::size_t i = 0; i < bands.size(); ++i) found[i] += edges.fraction[bands[i]] / seeds;
    }
    for (std::size_t i = 0; i < bands.size(); ++i) {
      const double hz = double{first.bands().centre_hz[bands[i]]};
      const double ratio = found[i] / screen.fraction(2 * std::numbers::pi * hz / double{first.speed_of_sound_m_per_s()});
      std::printf("setting %u, %.0f Hz: fraction %.4f, over that of the half plane %.3f\n", number, hz, found[i], ratio);
      EXPECT_NEAR(ratio, 1, 0.25) << hz << " " << number;
      mean[i] += ratio / 10;
    }
  }
  for (const double of_band : mean) EXPECT_NEAR(of_band, 1, 0.12);
}

}  // namespace
}  // namespace earshot
