// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/transmission.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <string>
#include <vector>

#include "sim/acoustics/model/wall_crossing.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/rooms.h"

/// docs/evidence/oracles.md, O-22; docs/evidence/stability.md, H-5, H-69.  Free field with panels across the x axis; oracle: 1 / (4 pi r)
/// and the table of tau against TL.
namespace earshot {
namespace {

using rooms::point;

struct Panel {
  double at_m = 0, thickness_m = 0;  // thickness 0: a sheet
  std::uint32_t material = 0;
  bool inside_out = false;
  int copies = 1;
};

/// A quad across x, 20 m wide.  `front`: its winding points to -x.
void append_face(TriangleMesh& mesh, double x, std::uint32_t material, bool front) {
  const double r = 10;
  const std::array<glm::vec3, 4> corner = {point(x, -r, -r), point(x, -r, r), point(x, r, r), point(x, r, -r)};
  const glm::vec3 normal = glm::cross(corner[1] - corner[0], corner[2] - corner[0]);
  if ((normal.x < 0) == front) {
    rooms::append_quad(mesh, corner, material);
  } else {
    rooms::append_quad(mesh, {corner[3], corner[2], corner[1], corner[0]}, material);
  }
}

std::shared_ptr<const Scene> panels(const std::vector<Panel>& walls, std::vector<Material> materials) {
  TriangleMesh mesh;
  for (const Panel& wall : walls) {
    for (int copy = 0; copy < wall.copies; ++copy) {
      append_face(mesh, wall.at_m, wall.material, !wall.inside_out);
      if (wall.thickness_m > 0) append_face(mesh, wall.at_m + wall.thickness_m, wall.material, wall.inside_out);
    }
  }
  return rooms::scene_of(std::move(mesh), std::move(materials));
}

Material wall_of(double tau) { return Material::uniform("wall", 1.f, 0.f, static_cast<float>(tau)); }

AcousticConfig config() {
  AcousticConfig c = rooms::plain_config();
  c.transmission_walls = 50;
  return c;
}

const glm::vec3 kBefore = point(-1, 0.3, 0.2), kBehind = point(4, 0.3, 0.2);  // 5 m apart

std::vector<Arrival> transmitted(const AcousticScene& scene, glm::vec3 source = kBefore, glm::vec3 listener = kBehind) {
  std::vector<Arrival> arrivals;
  find_transmitted(scene, source, listener, arrivals);
  return arrivals;
}

/// Level against the free field at 5 m, dB; 999 if nothing comes.
double loss_db(const AcousticScene& scene, int band = 0) {
  const std::vector<Arrival> arrivals = transmitted(scene);
  if (arrivals.size() != 1) return 999;
  return -20 * std::log10(arrivals[0].amplitude[band] * 4 * std::numbers::pi * 5);
}
double loss_db(const std::vector<Panel>& walls, const Material& material) {
  return loss_db(AcousticScene(panels(walls, {material}), config()));
}

// Amplitudes are floats: 1e-7 relative is 1e-6 dB, and so is that of tau; positions round to 1e-7 of 5 m.
constexpr double kRoundingDb = 1e-5;

TEST(O22_Transmission, TableOfEnergyTransmissionAgainstLevel) {
  struct Row {
    double tau, loss_db, read_as_pressure_db;
  };
  for (const Row row : {Row{1, 0, 0}, Row{0.1, 10, 20}, Row{0.05, 13.0103, 26.0206}, Row{0.03, 15.2288, 30.4576}, Row{0.01, 20, 40},
                        Row{0.001, 30, 60}, Row{0.0001, 40, 80}, Row{1e-6, 60, 120}}) {
    const double measured = loss_db({{.at_m = 1}}, wall_of(row.tau));
    EXPECT_NEAR(measured, row.loss_db, 1e-4) << row.tau;  // the table has four decimals
    if (row.tau == 1) continue;
    EXPECT_GT(std::fabs(measured - row.read_as_pressure_db), 9) << "tau read as pressure, or at both faces";
  }
}

TEST(O22_Transmission, ArrivalIsTheStraightLine) {
  const AcousticScene scene(panels({{.at_m = 1}}, {wall_of(0.01)}), config());
  const std::vector<Arrival> arrivals = transmitted(scene);
  ASSERT_EQ(arrivals.size(), 1u);
  EXPECT_EQ(arrivals[0].kind, ArrivalKind::transmission);
  EXPECT_EQ(arrivals[0].order, 1);
  EXPECT_NEAR(arrivals[0].distance_m, 5.0, 1e-6);
  EXPECT_NEAR(glm::length(arrivals[0].direction - glm::vec3(-1, 0, 0)), 0.0, 1e-6);  // from the listener toward the source
  EXPECT_EQ(arrivals[0].departure, -arrivals[0].direction);
  // sqrt(0.01) / (4 pi 5 m) = 0.1 / 62.8319
  EXPECT_NEAR(arrivals[0].amplitude[0], 0.1 / 62.831853, 1e-9);
}

TEST(O22_Transmission, SheetAndBoxPassTheSame) {
  const Material wall = wall_of(0.003);
  const double sheet = loss_db({{.at_m = 1}}, wall);
  EXPECT_NEAR(sheet, 25.2288, 1e-4);
  for (const double thickness_m : {0.001, 0.02, 0.1, 0.3, 0.59}) {
    EXPECT_NEAR(loss_db({{.at_m = 1, .thickness_m = thickness_m}}, wall), sheet, kRoundingDb) << thickness_m;
    EXPECT_NEAR(loss_db({{.at_m = 1, .thickness_m = thickness_m, .inside_out = true}}, wall), sheet, kRoundingDb) << thickness_m;
  }
  // Two faces too far apart are two walls.
  EXPECT_NEAR(loss_db({{.at_m = 1, .thickness_m = 0.61}}, wall), 2 * sheet, 2 * kRoundingDb);
}

TEST(O22_Transmission, FacesOfDifferentWallsAreNotPaired) {
  // Sheets that face the same way, near each other.
  EXPECT_NEAR(loss_db({{.at_m = 1}, {.at_m = 1.1}}, wall_of(0.1)), 20, kRoundingDb);
  // Two materials.
  const std::vector<Panel> two = {{.at_m = 1, .material = 0}, {.at_m = 1.1, .material = 1, .inside_out = true}};
  Material other = wall_of(0.01);
  EXPECT_NEAR(loss_db(AcousticScene(panels(two, {wall_of(0.1), other}), config())), 30, kRoundingDb);
  // The same material in two slots is one wall.
  EXPECT_NEAR(loss_db(AcousticScene(panels(two, {wall_of(0.1), wall_of(0.1)}), config())), 10, kRoundingDb);
}

TEST(O22_Transmission, BoxWallsNearEachOtherStayTwoWalls) {
  // Faces alternate all along the line: front, back, front, back.
  EXPECT_NEAR(loss_db({{.at_m = 1, .thickness_m = 0.1}, {.at_m = 1.3, .thickness_m = 0.1}}, wall_of(0.1)), 20, 2 * kRoundingDb);
  // A sheet seen from its back, then a wall: the gap between them is not a wall.
  const std::vector<Panel> sheet_and_wall = {{.at_m = 1, .inside_out = true}, {.at_m = 1.3, .thickness_m = 0.1}};
  Material damped = wall_of(0.1);
  damped.damping_db_per_m = CoefficientCurve::constant(30);
  const AcousticScene scene(panels(sheet_and_wall, {damped}), config());
  EXPECT_NEAR(loss_db(scene), 20 + 0.1 * 30, 1e-4);  // positions round to 1e-7 m times 30 dB/m
}

TEST(O22_Transmission, CornersOfAWallAreOneWall) {
  // A post of 0.3 m: in at the front, out at the side.  The line at 45 degrees cuts a corner of 0.1 m.
  const auto post = [](bool inside_out) {
    TriangleMesh mesh;
    const auto face = [&](std::array<glm::vec3, 4> c) {
      if (inside_out) std::swap(c[1], c[3]);
      rooms::append_quad(mesh, c, 0);
    };
    const float s = 0.3f;
    const auto at = [&](float x, float y, float z) { return glm::vec3(x * s, 20 * y - 10, z * s); };
    face({at(0, 0, 0), at(0, 0, 1), at(0, 1, 1), at(0, 1, 0)});  // -x
    face({at(1, 0, 0), at(1, 1, 0), at(1, 1, 1), at(1, 0, 1)});  // +x
    face({at(0, 0, 0), at(0, 1, 0), at(1, 1, 0), at(1, 0, 0)});  // -z
    face({at(0, 0, 1), at(1, 0, 1), at(1, 1, 1), at(0, 1, 1)});  // +z
    return rooms::scene_of(std::move(mesh), {wall_of(0.01)});
  };
  const glm::vec3 a(-0.9f, 0, 1), b(1.1f, 0, -1);  // along x + z = 0.1
  for (const auto& [from, to] : {std::pair{a, b}, std::pair{b, a}}) {
    const std::vector<Arrival> arrivals = transmitted(AcousticScene(post(false), config()), from, to);
    ASSERT_EQ(arrivals.size(), 1u);
    EXPECT_EQ(arrivals[0].order, 1);
    const double free = 1 / (4 * std::numbers::pi * std::sqrt(8.0));
    EXPECT_NEAR(-20 * std::log10(arrivals[0].amplitude[0] / free), 20, 1e-4);
    // Inside out nothing tells a corner from two sheets.
    EXPECT_EQ(transmitted(AcousticScene(post(true), config()), from, to)[0].order, 2);
  }
}

TEST(H5_Transmission, CoincidentTrianglesCountOnce) {
  EXPECT_NEAR(loss_db({{.at_m = 1, .copies = 3}}, wall_of(0.01)), 20, kRoundingDb);
  EXPECT_NEAR(loss_db({{.at_m = 1, .thickness_m = 0.2, .copies = 2}}, wall_of(0.01)), 20, kRoundingDb);
  // A sheet modelled from both sides.
  EXPECT_NEAR(loss_db({{.at_m = 1}, {.at_m = 1, .inside_out = true}}, wall_of(0.01)), 20, kRoundingDb);
}

TEST(O22_Transmission, DampingAndDelayInside) {
  // 0.2 m of 30 dB/m are 6 dB; 0.2 m at 1484 m/s instead of 343 m/s.
  Material water = wall_of(0.1);
  water.damping_db_per_m = CoefficientCurve::constant(30);
  water.speed_m_per_s = 1484;
  const AcousticScene scene(panels({{.at_m = 1, .thickness_m = 0.2}}, {water}), config());
  EXPECT_NEAR(loss_db(scene), 10 + 6, 1e-4);
  const double delay_s = transmitted(scene)[0].distance_m / 343.0;
  EXPECT_NEAR(delay_s, 4.8 / 343 + 0.2 / 1484, 1e-8);  // float metres round to 5e-7
  // A sheet has no inside.
  const AcousticScene sheet(panels({{.at_m = 1}}, {water}), config());
  EXPECT_NEAR(loss_db(sheet), 10, kRoundingDb);
  EXPECT_NEAR(transmitted(sheet)[0].distance_m, 5, 1e-6);
}

TEST(O22_Transmission, SlantedPathsAreLongerInside) {
  Material wall = wall_of(1);
  wall.damping_db_per_m = CoefficientCurve::constant(30);
  const AcousticScene scene(panels({{.at_m = 1, .thickness_m = 0.2}}, {wall}), config());
  const std::vector<Arrival> arrivals = transmitted(scene, point(0, 0.1, -1.9), point(2, 0.1, 0.1));  // 45 degrees
  ASSERT_EQ(arrivals.size(), 1u);
  const double r = std::sqrt(8.0), free = 1 / (4 * std::numbers::pi * r);
  // The ray starts anew 256 roundings off the near face, 3e-5 m aside of the line: 1e-3 dB at 30 dB/m.
  EXPECT_NEAR(-20 * std::log10(arrivals[0].amplitude[0] / free), 30 * 0.2 * std::numbers::sqrt2, 1e-3);
}

/// A block across x, 20 m wide, its windings outward; inward: a room.
void append_block(TriangleMesh& mesh, float x, float thickness_m, bool inward = false) {
  constexpr float r = 10;
  const glm::vec3 lower(x, -r, -r), upper(x + thickness_m, r, r);
  const auto at = [&](int i, int j, int k) { return glm::vec3(i ? upper.x : lower.x, j ? upper.y : lower.y, k ? upper.z : lower.z); };
  std::array<std::array<glm::vec3, 4>, 6> sides{{{at(0, 0, 0), at(0, 0, 1), at(0, 1, 1), at(0, 1, 0)},
                                                 {at(1, 0, 0), at(1, 1, 0), at(1, 1, 1), at(1, 0, 1)},
                                                 {at(0, 0, 0), at(1, 0, 0), at(1, 0, 1), at(0, 0, 1)},
                                                 {at(0, 1, 0), at(0, 1, 1), at(1, 1, 1), at(1, 1, 0)},
                                                 {at(0, 0, 0), at(0, 1, 0), at(1, 1, 0), at(1, 0, 0)},
                                                 {at(0, 0, 1), at(1, 0, 1), at(1, 1, 1), at(0, 1, 1)}}};
  for (auto& side : sides) {
    if (inward) std::swap(side[1], side[3]);
    rooms::append_quad(mesh, side, 0);
  }
}

Material damping_wall(double tau, double damping_db_per_m) {
  Material wall = wall_of(tau);
  wall.damping_db_per_m = CoefficientCurve::constant(static_cast<float>(damping_db_per_m));
  return wall;
}

AcousticScene block(float x, float thickness_m, const Material& material) {
  TriangleMesh mesh;
  append_block(mesh, x, thickness_m);
  return AcousticScene(rooms::scene_of(std::move(mesh), {material}), config());
}

// A body of a material that damps is filled, however far apart its faces and at whatever angle.
TEST(O22_Transmission, ASolidDampsAtEveryThickness) {
  for (std::uint32_t number = 0; number < 20; ++number) {
    const RandomStream random(38, Purpose::test, number);
    const float thickness_m = 0.05f + 3.5f * random.uniform(0);
    const double tau = 0.01 + 0.9 * static_cast<double>(random.uniform(1));
    const double damping = 1.01 * static_cast<double>(kSolidDampingDbPerM) + 20 * static_cast<double>(random.uniform(2));
    const AcousticScene scene = block(0.2f, thickness_m, damping_wall(tau, damping));
    const glm::vec3 from = kBefore, to = kBehind + glm::vec3(0, 2 * random.uniform(3), 2 * random.uniform(4));
    const double length_m = glm::length(glm::dvec3(to - from)), inside_m = static_cast<double>(thickness_m) * length_m / 5;
    for (const auto& [source, listener] : {std::pair{from, to}, std::pair{to, from}}) {
      const std::vector<Arrival> arrivals = transmitted(scene, source, listener);
      ASSERT_EQ(arrivals.size(), 1u) << thickness_m;
      EXPECT_EQ(arrivals[0].order, 1);
      const double loss = -20 * std::log10(arrivals[0].amplitude[0] * 4 * std::numbers::pi * length_m);
      EXPECT_NEAR(loss, -10 * std::log10(tau) + damping * inside_m, 2e-3) << thickness_m << " m of " << damping << " dB/m";
    }
  }
}

TEST(O22_Transmission, WhatHardlyDampsIsNoSolid) {
  const double damping = 0.99 * static_cast<double>(kSolidDampingDbPerM);
  EXPECT_NEAR(loss_db(block(1, 0.61f, damping_wall(0.1, damping))), 20, 2 * kRoundingDb);
  EXPECT_NEAR(loss_db(block(1, 0.59f, damping_wall(0.1, damping))), 10 + 0.59 * damping, 1e-4);
}

// Partitions of a material that damps, with a corridor between them: their windings tell nothing, as they bound no body.
TEST(O22_Transmission, SheetsBoundNoSolid) {
  const Material wall = damping_wall(0.1, 30);
  EXPECT_NEAR(loss_db({{.at_m = 0, .thickness_m = 3}}, wall), 20, 2 * kRoundingDb);
  // Nor do two houses whose walls are wound inward.
  TriangleMesh houses;
  append_block(houses, -9, 9, true);
  append_block(houses, 3, 9, true);
  EXPECT_NEAR(loss_db(AcousticScene(rooms::scene_of(std::move(houses), {wall}), config())), 20, 2 * kRoundingDb);
}

// A room whose walls are wound outward is not filled: who is in it hears one sheet, in both directions.
TEST(O22_Transmission, ListenersInABodyAreInARoom) {
  const AcousticScene scene = block(0, 6, damping_wall(0.1, 30));
  for (const auto& [source, listener] : {std::pair{kBefore, kBehind}, std::pair{kBehind, kBefore}}) {
    const std::vector<Arrival> arrivals = transmitted(scene, source, listener);
    ASSERT_EQ(arrivals.size(), 1u);
    EXPECT_NEAR(-20 * std::log10(arrivals[0].amplitude[0] * 4 * std::numbers::pi * 5), 10, kRoundingDb);
  }
}

TEST(O22_Transmission, CrossingAsTheTracerSeesIt) {
  Material wall = wall_of(0.1);
  wall.damping_db_per_m = CoefficientCurve::constant(30);
  wall.speed_m_per_s = 1484;
  const AcousticScene scene(panels({{.at_m = 1, .thickness_m = 0.2}}, {wall}), config());
  const glm::vec3 along(1, 0, 0);
  const WallCrossing crossing = cross_wall(scene.surfaces(), along, scene.scene().rays().intersect(kBefore, along));
  EXPECT_TRUE(crossing.thick);
  EXPECT_NEAR(crossing.inside_m, 0.2, 1e-6);
  EXPECT_GT(crossing.exit.x, 1.2f);
  EXPECT_FALSE(scene.scene().rays().intersect(crossing.exit, along).valid());
  std::vector<float> fraction(1, 0.5f);
  transmit(scene.surfaces(), crossing, fraction);
  EXPECT_NEAR(fraction[0], 0.5 * 0.1 * std::pow(10, -0.6), 1e-7);
  EXPECT_NEAR(extra_path_m(scene.surfaces(), crossing), 0.2 * 343 / 1484 - 0.2, 1e-6);
}

TEST(H69_Transmission, ManySheetsAddInDecibels) {
  std::vector<Panel> fifty;
  for (int i = 0; i < 50; ++i) fifty.push_back({.at_m = 0.05 * i});
  // 50 times 3.9 dB = 195 dB; the product of energies, 3e-20, is far below what a float sum would keep.
  EXPECT_NEAR(loss_db(fifty, wall_of(std::pow(10, -0.39))), 195, 50 * kRoundingDb);
  EXPECT_EQ(loss_db(fifty, wall_of(std::pow(10, -0.41))), 999);  // 205 dB: silence
  EXPECT_EQ(loss_db(fifty, wall_of(1e-6)), 999);                 // 3000 dB: no denormals, no NaN
  EXPECT_NEAR(loss_db(fifty, wall_of(1)), 0, kRoundingDb);
  fifty.push_back({.at_m = 3});
  EXPECT_EQ(loss_db(fifty, wall_of(1)), 999);  // more than transmission_walls
}

TEST(Transmission, CountsWallsNotFaces) {
  AcousticConfig few = config();
  few.transmission_walls = 2;
  const std::vector<Panel> two = {{.at_m = 0, .thickness_m = 0.1}, {.at_m = 1, .thickness_m = 0.1}};
  const AcousticScene scene(panels(two, {wall_of(0.1)}), few);
  ASSERT_EQ(transmitted(scene).size(), 1u);
  EXPECT_EQ(transmitted(scene)[0].order, 2);
  few.transmission_walls = 1;
  EXPECT_TRUE(transmitted(AcousticScene(panels(two, {wall_of(0.1)}), few)).empty());
}

TEST(Transmission, EveryBandHasItsOwn) {
  Material wall = wall_of(1);
  wall.transmission = {{125, 250, 500, 1000, 2000, 4000}, {0.1f, 0.03f, 0.01f, 0.f, 0.001f, 1e-6f}};
  AcousticConfig c = config();
  c.bands = 0;
  const AcousticScene scene(panels({{.at_m = 1}}, {wall}), c);
  const std::vector<Arrival> arrivals = transmitted(scene);
  ASSERT_EQ(arrivals.size(), 1u);
  for (int band = 0; band < scene.num_bands(); ++band) {
    const double expected = std::sqrt(wall.transmission.band_mean(scene.bands().edge_hz[band], scene.bands().edge_hz[band + 1]));
    EXPECT_NEAR(arrivals[0].amplitude[band] * 4 * std::numbers::pi * 5, expected, 1e-6) << band;
  }
  EXPECT_GT(arrivals[0].amplitude[0], arrivals[0].amplitude[1]);
}

TEST(Transmission, AirAbsorbsOutsideTheWallOnly) {
  AcousticConfig c = config();
  c.air_absorption = Switch::on;
  c.bands = 0;
  const AcousticScene sheet(panels({{.at_m = 1}}, {wall_of(0.1)}), c), thick(panels({{.at_m = 1, .thickness_m = 0.5}}, {wall_of(0.1)}), c);
  const auto top = static_cast<int>(sheet.num_bands() - 1);
  const double per_m = sheet.air_energy_per_m()[top];
  ASSERT_GT(per_m, 0.01);
  const double lost_db = 10 * per_m * std::numbers::log10e;
  EXPECT_NEAR(loss_db(sheet, top), 10 + 5.0 * lost_db, 1e-5);
  EXPECT_NEAR(loss_db(thick, top), 10 + 4.5 * lost_db, 1e-5);
}

TEST(O17_Transmission, SwappedEndsGiveTheSameBits) {
  // Walls of all kinds, positions that round, a slanted line.
  Material wall = wall_of(0.37);
  wall.damping_db_per_m = CoefficientCurve::constant(7.3f);
  wall.speed_m_per_s = 2000;
  const AcousticScene scene(panels({{.at_m = 0.1, .inside_out = true},
                                    {.at_m = 0.4, .thickness_m = 0.13},
                                    {.at_m = 1.7, .thickness_m = 0.31, .inside_out = true},
                                    {.at_m = 2.3},
                                    {.at_m = 2.31}},
                                   {wall}),
                            config());
  for (int i = 0; i < 50; ++i) {
    const glm::vec3 a = point(-0.1 - 0.11 * i, 0.013 * i, 0.07 * i), b = point(3 + 0.07 * i, 0.3 - 0.031 * i, 1.0 / (i + 1));
    const std::vector<Arrival> forward = transmitted(scene, a, b), backward = transmitted(scene, b, a);
    ASSERT_EQ(forward.size(), 1u);
    ASSERT_EQ(backward.size(), 1u);
    EXPECT_EQ(forward[0].order, 5);
    EXPECT_EQ(forward[0].distance_m, backward[0].distance_m);
    EXPECT_EQ(forward[0].amplitude, backward[0].amplitude);
    EXPECT_EQ(forward[0].direction, backward[0].departure);
  }
}

TEST(Transmission, ListenerInsideAWallHearsOneFace) {
  Material wall = wall_of(0.1);
  wall.damping_db_per_m = CoefficientCurve::constant(100);
  const AcousticScene scene(panels({{.at_m = 1, .thickness_m = 0.4}}, {wall}), config());
  const std::vector<Arrival> arrivals = transmitted(scene, kBefore, point(1.1, 0.3, 0.2));
  ASSERT_EQ(arrivals.size(), 1u);
  const double free = 1 / (4 * std::numbers::pi * 2.1);
  EXPECT_LE(-20 * std::log10(arrivals[0].amplitude[0] / free), 10 + 10 + 1e-3);
  EXPECT_GE(-20 * std::log10(arrivals[0].amplitude[0] / free), 10 - 1e-3);
}

TEST(Transmission, NothingWhereTheLineIsFree) {
  const AcousticScene scene(panels({{.at_m = 1}}, {wall_of(0.5)}), config());
  EXPECT_TRUE(transmitted(scene, point(-1, 0, 0), point(0.9, 0, 0)).empty());
  EXPECT_TRUE(transmitted(scene, point(0, 0, 0), point(0, 0, 0)).empty());
}

/// Everything of a response, as bits.
std::vector<float> bits_of(std::shared_ptr<const Scene> scene, Switch transmission) {
  AcousticConfig c;
  c.transmission = transmission;
  const AcousticScene acoustic(std::move(scene), c);
  EnergyResponse response;
  compute_energy_response(acoustic, EarlyCandidates(acoustic, kBefore), kBehind, response);
  std::vector<float> bits(response.late.values().begin(), response.late.values().end());
  for (const Arrival& arrival : response.arrivals) {
    bits.push_back(arrival.distance_m);
    bits.insert(bits.end(), arrival.amplitude.begin(), arrival.amplitude.end());
  }
  return bits;
}

TEST(Transmission, OffAndNothingTransmittingAreTheSameBits) {
  const auto opaque = [] { return panels({{.at_m = 1}}, {Material::uniform("wall", 0.3f, 0.2f, 0.f)}); };
  EXPECT_EQ(bits_of(opaque(), Switch::off), bits_of(opaque(), Switch::automatic));
  EXPECT_EQ(bits_of(opaque(), Switch::off), bits_of(opaque(), Switch::on));
  const auto thin = [] { return panels({{.at_m = 1}}, {Material::uniform("wall", 0.3f, 0.2f, 0.1f)}); };
  EXPECT_EQ(bits_of(thin(), Switch::on), bits_of(thin(), Switch::automatic));
  EXPECT_NE(bits_of(thin(), Switch::off), bits_of(thin(), Switch::automatic));
}

TEST(Transmission, RirHoldsItInOrderOfDistance) {
  // A wall between two rooms' halves: image paths in the floor do not exist, so the wall's arrival stands alone and the list is sorted.
  AcousticConfig c;
  c.late = Switch::off;
  const AcousticScene scene(panels({{.at_m = 1}}, {Material::uniform("wall", 0.3f, 0.f, 0.1f)}), c);
  EnergyResponse response;
  compute_energy_response(scene, EarlyCandidates(scene, kBefore), kBehind, response);
  ASSERT_EQ(std::ranges::count(response.arrivals, ArrivalKind::transmission, &Arrival::kind), 1);
  EXPECT_TRUE(std::ranges::is_sorted(response.arrivals, {}, &Arrival::distance_m));
  // O-22 for material that says tau > alpha: lowered to alpha (H-27).
  const AcousticScene greedy(panels({{.at_m = 1}}, {Material::uniform("wall", 0.1f, 0.f, 0.8f)}), config());
  EXPECT_NEAR(loss_db(greedy), 10, 1e-4);
}

}  // namespace
}  // namespace earshot
