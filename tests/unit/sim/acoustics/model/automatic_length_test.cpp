// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "tests/support/acoustics/effect_scenes.h"

namespace earshot {
namespace {

using effects::EffectScene;
using effects::material;
using rooms::point;

/// A hall of 20 x 15 x 4 m with soft walls, and in it a tiled bathroom of 2 x 2 x 2.4 m whose corner is at (x, y), with a doorway of so
/// many metres toward the middle of the hall.
EffectScene bathroom_off_a_hall(double x, double y, double door_m) {
  TriangleMesh mesh;
  rooms::append_box(mesh, {0, 0, 0}, {20, 15, 4}, 0);
  const double x1 = x + 2, y1 = y + 2, floor = 0.01, ceiling = 2.4, top = 2.0, door0 = y + 0.3, door1 = door0 + door_m;
  const auto wall = [&](double xa, double ya, double xb, double yb, double za, double zb) {
    rooms::append_quad(mesh, {point(xa, ya, za), point(xb, yb, za), point(xb, yb, zb), point(xa, ya, zb)}, 1);
  };
  for (const double z : {floor, ceiling}) rooms::append_quad(mesh, {point(x, y, z), point(x1, y, z), point(x1, y1, z), point(x, y1, z)}, 1);
  wall(x, y, x1, y, floor, ceiling);
  wall(x, y1, x1, y1, floor, ceiling);
  const double far = x < 10 ? x : x1, near = x < 10 ? x1 : x;
  wall(far, y, far, y1, floor, ceiling);
  wall(near, y, near, door0, floor, ceiling);
  wall(near, door1, near, y1, floor, ceiling);
  wall(near, door0, near, door1, top, ceiling);
  return {
      fmt::format("bathroom at {}, {}, door of {} m", x, y, door_m),
      rooms::scene_of(std::move(mesh), {material(0.5, 0.5), material(0.02, 0.3)}, Air{}),
      point(x + 1.3, y + 1.3, 1.4),
      {point(x + 0.6, y + 0.4, 1.5), point(x + 1.6, y + 0.7, 1.2), point(near + (x < 10 ? 1.5 : -1.5), y + 0.5, 1.5), point(9, 7, 1.5)}};
}

/// Two hard smooth walls 6 m apart, all else is soft.
EffectScene facing_mirrors() {
  std::array<Material, 6> walls;
  walls.fill(material(0.8, 0.5));
  walls[0] = walls[1] = material(0.06, 0.01);
  return {"facing mirrors", rooms::box(6, 9, 3.5, walls, 1, Air{}), point(1.7, 4.1, 1.4), {point(4.2, 5.2, 1.6), point(2.5, 4.6, 1.3)}};
}

/// The same, turned in the plan.
EffectScene facing_mirrors_aslant() {
  TriangleMesh mesh;
  const auto at = [&](double x, double y, double z) {
    const double c = std::cos(0.5), s = std::sin(0.5);
    return point(c * x - s * y, s * x + c * y, z);
  };
  const auto quad = [&](glm::vec3 a, glm::vec3 b, glm::vec3 c, glm::vec3 d, std::uint32_t slot) {
    rooms::append_quad(mesh, {a, b, c, d}, slot);
  };
  const double x = 6, y = 9, z = 3.5;
  quad(at(0, 0, 0), at(0, y, 0), at(0, y, z), at(0, 0, z), 0);
  quad(at(x, 0, 0), at(x, y, 0), at(x, y, z), at(x, 0, z), 0);
  quad(at(0, 0, 0), at(x, 0, 0), at(x, 0, z), at(0, 0, z), 1);
  quad(at(0, y, 0), at(x, y, 0), at(x, y, z), at(0, y, z), 1);
  quad(at(0, 0, 0), at(x, 0, 0), at(x, y, 0), at(0, y, 0), 1);
  quad(at(0, 0, z), at(x, 0, z), at(x, y, z), at(0, y, z), 1);
  return {"facing mirrors aslant",
          rooms::scene_of(std::move(mesh), {material(0.06, 0.01), material(0.8, 0.5)}, Air{}),
          at(1.7, 4.1, 1.4),
          {at(4.2, 5.2, 1.6), at(2.5, 4.6, 1.3)}};
}

/// Ground and four walls under the sky.
EffectScene courtyard() {
  TriangleMesh mesh;
  const double x = 18, y = 14, z = 10;
  rooms::append_quad(mesh, {point(0, 0, 0), point(x, 0, 0), point(x, y, 0), point(0, y, 0)}, 0);
  rooms::append_quad(mesh, {point(0, 0, 0), point(0, y, 0), point(0, y, z), point(0, 0, z)}, 1);
  rooms::append_quad(mesh, {point(x, 0, 0), point(x, y, 0), point(x, y, z), point(x, 0, z)}, 1);
  rooms::append_quad(mesh, {point(0, 0, 0), point(x, 0, 0), point(x, 0, z), point(0, 0, z)}, 1);
  rooms::append_quad(mesh, {point(0, y, 0), point(x, y, 0), point(x, y, z), point(0, y, z)}, 1);
  return {"courtyard",
          rooms::scene_of(std::move(mesh), {material(0.05, 0.2), material(0.06, 0.1)}, Air{}),
          point(5, 5, 1.5),
          {point(9, 8, 1.5), point(16, 12, 1.6), point(6, 5.5, 1.5)}};
}

/// 40 x 2.2 x 2.7 m, smooth side walls, carpet and a soft ceiling.
EffectScene corridor() {
  std::array<Material, 6> walls;
  walls.fill(material(0.05, 0.1));
  walls[4] = material(0.2, 0.2);
  walls[5] = material(0.5, 0.3);
  return {"corridor",
          rooms::box(40, 2.2, 2.7, walls, 1, Air{}),
          point(3, 1, 1.5),
          {point(5, 1.3, 1.5), point(20, 1.1, 1.6), point(38, 0.8, 1.5)}};
}

/// T30 of each octave from responses of the automatic length, against `long_s` with the same random numbers: rays only end later, so that
/// the difference is what the length cuts off and no noise.  5 % is what is just heard (ISO 3382-1).
void expect_t30_of_a_long_response(const EffectScene& where, double long_s) {
  AcousticConfig config;
  config.rays = 1024;
  config.rir_length_s = 0;
  config.field = Switch::off;
  config.air_absorption = Switch::on;  // by band, it depends on the length
  AcousticConfig longer = config;
  longer.rir_length_s = static_cast<float>(long_s);
  const AcousticScene scene(where.scene, config), long_scene(where.scene, longer);
  ASSERT_LT(scene.config().rir_length_s, long_s) << where.name;
  const EarlyCandidates candidates(scene, where.source), long_candidates(long_scene, where.source);
  double worst = 0, shortest_s = 1e9, longest_s = 0;
  int compared = 0;
  for (std::size_t i = 0; i < where.listeners.size(); ++i) {
    const RoomMetrics seen = measure(scene, effects::render(scene, candidates, where.listeners[i]));
    const RoomMetrics truth = measure(long_scene, effects::render(long_scene, long_candidates, where.listeners[i]));
    for (std::size_t band = 0; band < truth.bands.size(); ++band) {
      if (!truth.bands[band].t30_s) continue;
      const double truth_s = *truth.bands[band].t30_s;
      shortest_s = std::min(shortest_s, truth_s);
      longest_s = std::max(longest_s, truth_s);
      ++compared;
      EXPECT_TRUE(seen.bands[band].t30_s) << where.name << ", listener " << i << ", band " << band << ": " << truth_s << " s";
      if (!seen.bands[band].t30_s) continue;
      EXPECT_NEAR(*seen.bands[band].t30_s, truth_s, 0.05 * truth_s) << where.name << ", listener " << i << ", band " << band;
      worst = std::max(worst, std::abs(*seen.bands[band].t30_s / truth_s - 1));
    }
  }
  EXPECT_GE(compared, 6 * static_cast<int>(where.listeners.size())) << where.name;
  fmt::print("{}: {:.2f} s; T30 {:.2f} to {:.2f} s, at most {:.2f} % from that of {:.1f} s\n", where.name, scene.config().rir_length_s,
             shortest_s, longest_s, 100 * worst, long_s);
}

TEST(AutomaticLength, BathroomOffADeadHall) {
  for (const double door_m : {0.25, 0.5}) {
    for (const glm::dvec2 corner : {glm::dvec2(17.9, 12.9), glm::dvec2(13.7, 0.1), glm::dvec2(0.1, 6.2)}) {
      EffectScene where = bathroom_off_a_hall(corner.x, corner.y, door_m);
      expect_t30_of_a_long_response(where, 4);
      where.name += ", source outside";
      where.source = point(9, 6, 1.6);
      where.listeners.pop_back();
      expect_t30_of_a_long_response(where, 4);
    }
  }
}
TEST(AutomaticLength, FacingMirrors) {
  expect_t30_of_a_long_response(facing_mirrors(), 6);
  expect_t30_of_a_long_response(facing_mirrors_aslant(), 6);
}
TEST(AutomaticLength, Courtyard) { expect_t30_of_a_long_response(courtyard(), 6); }
TEST(AutomaticLength, Corridor) { expect_t30_of_a_long_response(corridor(), 4); }

}  // namespace
}  // namespace earshot
