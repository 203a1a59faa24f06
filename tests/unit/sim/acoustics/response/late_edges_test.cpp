// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/response/late_edges.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "sim/acoustics/model/air_points.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/effect_scenes.h"

namespace earshot {
namespace {

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

}  // namespace
}  // namespace earshot
