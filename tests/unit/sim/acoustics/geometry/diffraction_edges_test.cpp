// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/geometry/diffraction_edges.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <numbers>

#include "sim/base/random.h"
#include "sim/scene/scene.h"
#include "tests/support/acoustics/rooms.h"
#include "tests/support/files/test_data.h"

namespace earshot {
namespace {

constexpr double kPi = std::numbers::pi;

std::shared_ptr<const Scene> scene_from(TriangleMesh mesh) {
  return rooms::scene_of(std::move(mesh), {Material::uniform("hard", 0.f, 0.f)});
}

TriangleMesh box_mesh(glm::vec3 lower, glm::vec3 upper) {
  TriangleMesh mesh;
  append_box(mesh, lower, upper, 0, 0);
  return mesh;
}

int count_exterior(const DiffractionEdges& edges, double exterior_rad) {
  return static_cast<int>(std::count_if(edges.edges().begin(), edges.edges().end(),
                                        [&](const DiffractionEdge& edge) { return std::abs(edge.exterior_rad - exterior_rad) < 1e-3; }));
}

TEST(DiffractionEdges, BoxHasTwelveRightCorners) {
  const auto scene = scene_from(box_mesh({0, 0, 0}, {1, 2, 3}));
  const DiffractionEdges edges(*scene, 0.25f);
  ASSERT_EQ(edges.size(), 12u);  // and no diagonal of a quad
  EXPECT_EQ(count_exterior(edges, 1.5 * kPi), 12);
  double length_m = 0;
  for (const DiffractionEdge& edge : edges.edges()) {
    length_m += edge.length_m;
    // Outside is air, inside is not, whatever the winding.
    EXPECT_FALSE(edge.in_air({0.5, 1, 1.5}, 1e-6));
    EXPECT_TRUE(edge.in_air(edge.at(0.3) + edge.outward(), 1e-6));
    EXPECT_GT(glm::length(edge.at(0.3) + edge.outward() - glm::dvec3(0.5, 1, 1.5)), glm::length(edge.at(0.3) - glm::dvec3(0.5, 1, 1.5)));
  }
  EXPECT_NEAR(length_m, 4 * (1 + 2 + 3), 1e-5);
  EXPECT_EQ(DiffractionEdges(*scene, 1.5f).size(), 8u);  // those of 1 m are too short
}

TEST(DiffractionEdges, WindingDoesNotMatter) {
  TriangleMesh mesh = box_mesh({0, 0, 0}, {1, 2, 3});
  for (std::size_t i = 0; i < mesh.triangles.size(); i += 2) std::swap(mesh.triangles[i].x, mesh.triangles[i].y);
  const auto scene = scene_from(mesh);
  const DiffractionEdges edges(*scene, 0.25f);
  EXPECT_EQ(edges.size(), 12u);
  EXPECT_EQ(count_exterior(edges, 1.5 * kPi), 12);
}

TEST(DiffractionEdges, ConvexRoomShowsNoEdgeFromWithin) {
  const auto room = rooms::shoe1(0.1, 0.1);
  const DiffractionEdges edges(*room, 0.25f);
  for (std::uint32_t e = 0; e < edges.size(); ++e) {
    EXPECT_FALSE(edges.visible_from(e, rooms::shoe1_source()));
    EXPECT_FALSE(edges[e].in_air(glm::dvec3(rooms::shoe1_listener()), 1e-6));
  }
}

TEST(DiffractionEdges, RimOfASheetIsAHalfPlaneAndItsPiecesAreOne) {
  // A sheet of 4 x 2 m cut into 8 x 3 quads: four rims, no edge within.
  TriangleMesh mesh;
  for (int i = 0; i < 8; ++i) {
    for (int j = 0; j < 3; ++j) {
      const auto at = [](double x, double y) { return glm::vec3(x / 2, 2 * y / 3, 0); };
      rooms::append_quad(mesh, {at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)}, 0);
    }
  }
  const auto scene = scene_from(mesh);
  const DiffractionEdges edges(*scene, 1.f);  // longer than any piece
  ASSERT_EQ(edges.size(), 4u);
  EXPECT_EQ(count_exterior(edges, 2 * kPi), 4);
  EXPECT_NEAR(edges[0].length_m, 4, 1e-5);
  EXPECT_NEAR(edges[3].length_m, 2, 1e-5);
  for (const DiffractionEdge& edge : edges.edges()) {
    const glm::dvec3 on_sheet = edge.at(0.5 * edge.length_m) + 0.5 * edge.face;
    EXPECT_TRUE(on_sheet.x > 0 && on_sheet.x < 4 && on_sheet.y > 0 && on_sheet.y < 2);
    EXPECT_NEAR(on_sheet.z, 0, 1e-6);
  }
}

TEST(DiffractionEdges, FlatEdgesAndDegenerateTrianglesAreNone) {
  // Two quads that meet at 4 degrees, and at 6; a triangle without area on the common edge (docs/evidence/stability.md, H-66).
  for (const double degrees : {4.0, 6.0}) {
    const double slope = std::tan(degrees * kPi / 180);
    TriangleMesh mesh;
    rooms::append_quad(mesh, {glm::vec3(-1, 0, 0), glm::vec3(0, 0, 0), glm::vec3(0, 0, 1), glm::vec3(-1, 0, 1)}, 0);
    rooms::append_quad(mesh, {glm::vec3(0, 0, 0), glm::vec3(1, -slope, 0), glm::vec3(1, -slope, 1), glm::vec3(0, 0, 1)}, 0);
    mesh.triangles.push_back({1, 2, 1});
    mesh.triangle_material.push_back(0);
    mesh.triangle_object.push_back(0);
    const auto scene = scene_from(mesh);
    const DiffractionEdges edges(*scene, 0.25f);
    const auto ridges =
        std::count_if(edges.edges().begin(), edges.edges().end(), [](const auto& edge) { return edge.exterior_rad < 1.9 * kPi; });
    EXPECT_EQ(ridges, degrees > 5 ? 1 : 0);
    EXPECT_EQ(count_exterior(edges, 2 * kPi), 6);  // rims: 3 + 3; each long side breaks at the ridge
  }
}

TEST(DiffractionEdges, ThreeSheetsAtOneEdge) {
  // Sheets toward 0, 60 and 120 degrees: the sector of 240 is the wedge.  A fourth at 240 leaves none.
  for (const int sheets : {3, 4}) {
    TriangleMesh mesh;
    for (int i = 0; i < sheets; ++i) {
      const double angle = (i == 3 ? 240.0 : 60.0 * i) * kPi / 180;
      const glm::vec3 tip(std::cos(angle), std::sin(angle), 0);
      rooms::append_quad(mesh, {glm::vec3(0, 0, 0), tip, tip + glm::vec3(0, 0, 1), glm::vec3(0, 0, 1)}, 0);
    }
    const auto scene = scene_from(mesh);
    EXPECT_EQ(count_exterior(DiffractionEdges(*scene, 0.25f), 240.0 * kPi / 180), sheets == 3 ? 1 : 0);
  }
}

TEST(DiffractionEdges, ContactWithoutCommonVerticesIsFoundByRays) {
  // A screen that stands in the middle of a floor of other triangles: top and sides are rims, the foot is not.
  TriangleMesh mesh;
  rooms::append_quad(mesh, {glm::vec3(-5, 0, -5), glm::vec3(5, 0, -5), glm::vec3(5, 0, 5), glm::vec3(-5, 0, 5)}, 0);
  rooms::append_quad(mesh, {glm::vec3(-1, 0, 0), glm::vec3(1, 0, 0), glm::vec3(1, 2, 0), glm::vec3(-1, 2, 0)}, 0);
  const auto scene = scene_from(mesh);
  const DiffractionEdges edges(*scene, 0.25f);
  int of_screen = 0;
  for (const DiffractionEdge& edge : edges.edges()) {
    const glm::dvec3 middle = edge.at(0.5 * edge.length_m);
    if (std::abs(middle.z) > 1) continue;  // rims of the floor
    if (std::abs(middle.x) > 2) continue;
    ++of_screen;
    EXPECT_GT(middle.y, 0.5);
    EXPECT_NEAR(edge.exterior_rad, 2 * kPi, 1e-3);
  }
  EXPECT_EQ(of_screen, 3);

  // Two sheets in an L that fraction no vertex: one wedge of 270 degrees, not two half planes.
  TriangleMesh corner;
  rooms::append_quad(corner, {glm::vec3(0, 0, 0), glm::vec3(2, 0, 0), glm::vec3(2, 3, 0), glm::vec3(0, 3, 0)}, 0);
  rooms::append_quad(corner, {glm::vec3(0, -0.1, 0), glm::vec3(0, -0.1, 2), glm::vec3(0, 3.1, 2), glm::vec3(0, 3.1, 0)}, 0);
  const auto corner_scene = scene_from(corner);
  const DiffractionEdges corner_edges(*corner_scene, 0.25f);
  EXPECT_EQ(count_exterior(corner_edges, 1.5 * kPi), 1);
}

TEST(DiffractionEdges, SightBetweenEdgesGoesBothWaysAndThroughNoWall) {
  // Two boxes side by side and a third far behind a wall between.
  TriangleMesh mesh;
  append_box(mesh, {0, 0, 0}, {1, 1, 1}, 0, 0);
  append_box(mesh, {3, 0, 0}, {4, 1, 1}, 0, 0);
  append_box(mesh, {8, -50, -50}, {9, 50, 50}, 0, 0);
  append_box(mesh, {12, 0, 0}, {13, 1, 1}, 0, 0);
  const auto scene = rooms::scene_of(mesh, {Material::uniform("hard", 0.f, 0.f)});
  const DiffractionEdges edges(*scene, 0.25f);
  int pairs = 0;
  for (std::uint32_t e = 0; e < edges.size(); ++e) {
    for (std::uint32_t other = 0; other < edges.size(); ++other) {
      if (other == e || !edges.mutually_visible(e, other)) continue;
      ++pairs;
      EXPECT_TRUE(edges.mutually_visible(other, e));
      const double x = edges[e].at(0.5).x, y = edges[other].at(0.5).x;
      EXPECT_FALSE((x < 5 && y > 10) || (y < 5 && x > 10));
    }
  }
  EXPECT_GT(pairs, 48);
}

TEST(DiffractionEdges, AWallOfStripsOnAFloorHasNoRimThere) {
  // The foot and the top of the wall at x = 0 share two vertices with floor and ceiling, all others touch them.
  TriangleMesh mesh;
  rooms::append_box(mesh, {0, 0, 0}, {6, 7.2, 4}, 0);
  mesh.triangles.erase(mesh.triangles.begin(), mesh.triangles.begin() + 2);
  mesh.triangle_material.erase(mesh.triangle_material.begin(), mesh.triangle_material.begin() + 2);
  mesh.triangle_object.erase(mesh.triangle_object.begin(), mesh.triangle_object.begin() + 2);
  for (int i = 0; i < 12; ++i) {
    const double y = 0.6 * i;
    rooms::append_quad(mesh, {rooms::point(0, y, 0), rooms::point(0, y + 0.6, 0), rooms::point(0, y + 0.6, 4), rooms::point(0, y, 4)}, 0);
  }
  const auto scene = scene_from(mesh);
  const DiffractionEdges edges(*scene, 0.25f);
  EXPECT_EQ(edges.size(), 12u);
  EXPECT_EQ(count_exterior(edges, 1.5 * kPi), 12);
}

TEST(DiffractionEdges, FacesAreFollowedAsFarAsTheyGo) {
  // A board of 0.3 x 2 x 0.03 m, and a floor far below it, which does not belong to its faces.
  TriangleMesh mesh;
  rooms::append_box(mesh, {0, 0, 1}, {0.3, 2, 1.03}, 0);
  rooms::append_quad(mesh, {rooms::point(-20, -20, 0), rooms::point(20, -20, 0), rooms::point(20, 20, 0), rooms::point(-20, 20, 0)}, 0);
  const auto scene = rooms::scene_of(std::move(mesh), {Material::uniform("hard", 0.f, 0.f)});
  int board = 0, floor = 0;
  const DiffractionEdges edges(*scene, 0.1f);
  for (const DiffractionEdge& edge : edges.edges()) {
    if (edge.length_m > 10) {
      ++floor;
      EXPECT_EQ(edge.first_width_m, kWideFaceM);
      EXPECT_EQ(edge.second_width_m, kWideFaceM);
      continue;
    }
    ++board;
    // Across the edge a face of the board is as wide as the board is in the direction of the face.
    for (const auto& [face, width_m] : {std::pair(edge.face, edge.first_width_m), std::pair(edge.second_face(), edge.second_width_m)}) {
      const double true_m = std::abs(face.y) > 0.9 ? 0.03 : std::abs(face.x) > 0.9 ? 0.3 : 2.0;
      EXPECT_LE(width_m, true_m + 1e-6);
      EXPECT_GE(width_m, 0.85 * true_m);
    }
  }
  EXPECT_EQ(board, 8);  // edges of 0.03 m are dropped
  EXPECT_GE(floor, 4);
}

TEST(DiffractionEdges, EmptySceneHasNone) { EXPECT_EQ(DiffractionEdges(*rooms::empty(), 0.25f).size(), 0u); }

TEST(DiffractionEdges, SmallHouse) {
  SKIP_WITHOUT_DATA("scenes/small_house.glb");
  const Scene scene = load_scene((data_folder() / "scenes/small_house.glb").string());
  const DiffractionEdges edges(scene, 0.25f);
  EXPECT_GT(edges.size(), 500u);
  EXPECT_LT(edges.size(), 20'000u);
  for (const DiffractionEdge& edge : edges.edges()) {
    EXPECT_GE(edge.length_m, 0.25);
    EXPECT_GT(edge.exterior_rad, kPi * 185 / 180 - 1e-9);
    EXPECT_LE(edge.exterior_rad, 2 * kPi + 1e-9);
    EXPECT_NEAR(glm::dot(edge.along, edge.face), 0, 1e-9);
  }
}

// What is remembered decides how long an answer takes, never what it is: edges that have been asked along a walk, and from other places
// before, say what edges say that are asked for the first time.
TEST(DiffractionEdges, VisibilityDoesNotDependOnWhatWasAskedBefore) {
  const Scene scene = load_scene("house:4,rooms=3,area_m2=40");
  const DiffractionEdges walked(scene, 0.25f);
  const RandomStream random(3, Purpose::test);
  const glm::vec3 lower = scene.bounds().lower, size = scene.bounds().upper - lower;
  std::vector<glm::vec3> points;
  for (std::uint32_t i = 0; i < 12; ++i) {
    const auto u = random.uniform4(i);
    const glm::vec3 start = lower + size * glm::vec3(u[0], 0.2f + 0.6f * u[1], u[2]);
    for (int step = 0; step < 6; ++step) points.push_back(start + 0.15f * static_cast<float>(step) * glm::vec3(0.8f, 0.f, 0.6f));
  }
  std::vector<std::vector<bool>> seen;
  for (const glm::vec3 point : points) {
    auto& row = seen.emplace_back();
    for (std::uint32_t edge = 0; edge < walked.size(); ++edge) row.push_back(walked.visible_from(edge, point));
  }
  int visible = 0;
  for (std::size_t i = points.size(); i-- > 0;) {
    const DiffractionEdges fresh = i % 24 == 0 ? DiffractionEdges(scene, 0.25f) : walked;
    for (std::uint32_t edge = static_cast<std::uint32_t>(walked.size()); edge-- > 0;) {
      EXPECT_EQ(fresh.visible_from(edge, points[i]), seen[i][edge]) << edge;
      EXPECT_EQ(walked.visible_from(edge, points[i]), seen[i][edge]) << edge;
      visible += seen[i][edge] ? 1 : 0;
    }
  }
  EXPECT_GT(visible, 1000);
  const DiffractionEdges fresh(scene, 0.25f);
  int pairs = 0;
  for (std::uint32_t edge = 0; edge < std::min<std::size_t>(walked.size(), 120); ++edge)
    for (std::uint32_t other = 0; other < edge; ++other) {
      const bool first = walked.mutually_visible(edge, other);
      EXPECT_EQ(walked.mutually_visible(edge, other), first);
      EXPECT_EQ(fresh.mutually_visible(other, edge), first);
      pairs += first ? 1 : 0;
    }
  EXPECT_GT(pairs, 50);
}

}  // namespace
}  // namespace earshot
