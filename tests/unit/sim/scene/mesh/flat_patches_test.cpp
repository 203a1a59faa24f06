// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/mesh/flat_patches.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <glm/geometric.hpp>
#include <limits>
#include <map>
#include <set>

#include "sim/base/random.h"
#include "sim/rays/embree_scene.h"
#include "sim/scene/mesh/patch_collapse.h"
#include "sim/scene/scene.h"

namespace earshot {
namespace {

double area_of(const TriangleMesh& mesh, glm::uvec3 t) {
  const glm::dvec3 a = mesh.vertices[t.x], b = mesh.vertices[t.y], c = mesh.vertices[t.z];
  return 0.5 * glm::length(glm::cross(b - a, c - a));
}

using Place = std::function<glm::vec3(float u, float v)>;

/// A square of n x n cells, u and v from 0 to 1, all of material 0 and object 0.
TriangleMesh sheet(std::uint32_t n, const Place& place) {
  TriangleMesh mesh;
  for (std::uint32_t i = 0; i <= n; ++i)
    for (std::uint32_t j = 0; j <= n; ++j)
      mesh.vertices.push_back(place(static_cast<float>(i) / static_cast<float>(n), static_cast<float>(j) / static_cast<float>(n)));
  const auto at = [n](std::uint32_t i, std::uint32_t j) { return i * (n + 1) + j; };
  for (std::uint32_t i = 0; i < n; ++i)
    for (std::uint32_t j = 0; j < n; ++j) {
      mesh.triangles.emplace_back(at(i, j), at(i + 1, j), at(i + 1, j + 1));
      mesh.triangles.emplace_back(at(i, j), at(i + 1, j + 1), at(i, j + 1));
    }
  mesh.triangle_material.assign(mesh.triangles.size(), 0);
  mesh.triangle_object.assign(mesh.triangles.size(), 0);
  mesh.material_names = {"a", "b"};
  mesh.object_names = {"sheet", "other"};
  return mesh;
}

/// Sides that one triangle has and no other: the border, each in its direction.
std::set<std::pair<std::uint32_t, std::uint32_t>> border_of(const std::vector<glm::uvec3>& triangles) {
  std::set<std::pair<std::uint32_t, std::uint32_t>> sides;
  for (const glm::uvec3 t : triangles)
    for (int i = 0; i < 3; ++i) sides.emplace(t[i], t[(i + 1) % 3]);
  std::erase_if(sides, [all = sides](const auto& side) { return all.contains({side.second, side.first}); });
  return sides;
}

TEST(FlatPatches, ASheetKeepsItsAreaAndBorderInFewTriangles) {
  // On the axes, and turned and moved so that every vertex is rounded.
  const glm::vec3 u = glm::normalize(glm::vec3(0.3f, 0.7f, -0.2f)), v = glm::normalize(glm::cross(u, glm::vec3(0.1f, 0.2f, 1.f)));
  for (const Place& place : {Place([](float a, float b) { return glm::vec3(4 * a, 0, 3 * b); }),
                             Place([&](float a, float b) { return glm::vec3(7, -2, 5) + 4 * a * u + 3 * b * v; })}) {
    const TriangleMesh mesh = sheet(40, place);
    const RaySurface surface = merge_flat_patches(mesh);
    EXPECT_LT(surface.triangles.size(), 400u) << "158 triangles need the 160 vertices of the border";
    EXPECT_EQ(border_of(surface.triangles), border_of(mesh.triangles));
    double area_m2 = 0;
    for (const glm::uvec3 t : surface.triangles) area_m2 += area_of(mesh, t);
    EXPECT_NEAR(area_m2, 12.0, 1e-4);
  }
}

TEST(FlatPatches, MaterialsObjectsAndFacingsEndAPatch) {
  const auto place = [](float a, float b) { return glm::vec3(4 * a, 0, 3 * b); };
  const TriangleMesh whole = sheet(20, place);
  TriangleMesh materials = whole, objects = whole, facings = whole;
  for (std::size_t t = 0; t < whole.triangles.size() / 2; ++t) {
    materials.triangle_material[t] = 1;
    objects.triangle_object[t] = 1;
    std::swap(facings.triangles[t].y, facings.triangles[t].z);
  }
  const std::size_t alone = merge_flat_patches(whole).triangles.size();
  for (const TriangleMesh& mesh : {materials, objects, facings}) {
    const RaySurface surface = merge_flat_patches(mesh);
    EXPECT_GT(surface.triangles.size(), alone) << "the line between them is a border";
    std::map<std::uint32_t, double> area_m2;
    for (std::size_t i = 0; i < surface.triangles.size(); ++i) {
      const std::uint32_t meant = surface.stands_for[i];
      area_m2[mesh.triangle_material[meant] + 2 * mesh.triangle_object[meant]] += area_of(mesh, surface.triangles[i]);
      const auto normal = [&](glm::uvec3 t) {
        return glm::cross(mesh.vertices[t.y] - mesh.vertices[t.x], mesh.vertices[t.z] - mesh.vertices[t.x]);
      };
      EXPECT_GT(glm::dot(normal(surface.triangles[i]), normal(mesh.triangles[meant])), 0.f);
    }
    for (const auto& [kind, area] : area_m2) EXPECT_NEAR(area, area_m2.size() == 1 ? 12.0 : 6.0, 1e-5);
  }
}

TEST(FlatPatches, CurvedSurfacesStayAsTheyAre) {
  const TriangleMesh bowl =
      sheet(30, [](float a, float b) { return glm::vec3(4 * a, 0.3f * ((a - 0.5f) * (a - 0.5f) + (b - 0.5f) * (b - 0.5f)), 4 * b); });
  const RaySurface surface = merge_flat_patches(bowl);
  EXPECT_EQ(surface.triangles, bowl.triangles);
  for (std::uint32_t i = 0; i < surface.stands_for.size(); ++i) EXPECT_EQ(surface.stands_for[i], i);
  EXPECT_TRUE(merge_flat_patches(TriangleMesh{}).triangles.empty());
}

TEST(FlatPatches, WhatIsNotMergedKeepsItsOrder) {
  // Sheets of two triangles have no inner vertex; the one among them has.
  TriangleMesh mesh = sheet(1, [](float a, float b) { return glm::vec3(a, 1, b); });
  const auto append = [&](const TriangleMesh& part) {
    const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
    mesh.vertices.insert(mesh.vertices.end(), part.vertices.begin(), part.vertices.end());
    for (const glm::uvec3 t : part.triangles) mesh.triangles.push_back(t + glm::uvec3(first));
    mesh.triangle_material.resize(mesh.triangles.size());
    mesh.triangle_object.resize(mesh.triangles.size());
  };
  append(sheet(8, [](float a, float b) { return glm::vec3(a, 2, b); }));
  append(sheet(1, [](float a, float b) { return glm::vec3(a, 3, b); }));
  const std::vector<std::uint32_t> order = merge_flat_patches(mesh).stands_for;
  EXPECT_TRUE(std::is_sorted(order.begin(), order.end()));
  EXPECT_EQ((std::vector{order[0], order[1]}), (std::vector<std::uint32_t>{0, 1}));
  EXPECT_EQ((std::vector{order[order.size() - 2], order.back()}), (std::vector<std::uint32_t>{130, 131}));
  EXPECT_LT(order.size(), 50u);
}

TEST(FlatPatches, HolesStayOpen) {
  TriangleMesh frame = sheet(30, [](float a, float b) { return glm::vec3(3 * a, 0, 3 * b); });
  std::erase_if(frame.triangles, [&](glm::uvec3 t) {
    const glm::vec3 middle = (frame.vertices[t.x] + frame.vertices[t.y] + frame.vertices[t.z]) / 3.f;
    return glm::length(glm::vec2(middle.x - 1.7f, middle.z - 1.2f)) < 0.8f;
  });
  frame.triangle_material.resize(frame.triangles.size());
  frame.triangle_object.resize(frame.triangles.size());
  const RaySurface surface = merge_flat_patches(frame);
  EXPECT_LT(surface.triangles.size(), frame.triangles.size() / 3);
  EXPECT_EQ(border_of(surface.triangles), border_of(frame.triangles));
  double before_m2 = 0, after_m2 = 0;
  for (const glm::uvec3 t : frame.triangles) before_m2 += area_of(frame, t);
  for (const glm::uvec3 t : surface.triangles) after_m2 += area_of(frame, t);
  EXPECT_NEAR(after_m2, before_m2, 1e-5);
}

TEST(FlatPatches, OddTrianglesStayAsTheyAre) {
  const TriangleMesh plain = sheet(12, [](float a, float b) { return glm::vec3(3 * a, 0, 3 * b); });
  const std::size_t alone = merge_flat_patches(plain).triangles.size();
  const auto with = [&](std::vector<glm::vec3> vertices, std::vector<glm::uvec3> triangles) {
    TriangleMesh mesh = plain;
    mesh.vertices.insert(mesh.vertices.end(), vertices.begin(), vertices.end());
    mesh.triangles.insert(mesh.triangles.end(), triangles.begin(), triangles.end());
    mesh.triangle_material.resize(mesh.triangles.size());
    mesh.triangle_object.resize(mesh.triangles.size());
    const RaySurface surface = merge_flat_patches(mesh);
    for (const glm::uvec3 t : triangles) EXPECT_EQ(std::ranges::count(surface.triangles, t), 1);
    double area_m2 = 0;
    for (const glm::uvec3 t : surface.triangles)
      if (mesh.vertices[t.x].y == 0 && mesh.vertices[t.y].y == 0 && mesh.vertices[t.z].y == 0) area_m2 += area_of(mesh, t);
    EXPECT_NEAR(area_m2, 9.0, 1e-5);
    return surface.triangles.size() - triangles.size();
  };
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(with({}, {{0, 0, 1}}), alone) << "two corners in one place";
  EXPECT_EQ(with({{nan, 1, 0}}, {{0, 1, 169}}), alone) << "a place that is no number";
  EXPECT_EQ(with({{1.5f, 1, 1.5f}, {1.6f, 1, 1.5f}}, {{84, 169, 170}}), alone) << "the tip of another wall on an inner vertex";
  // A wall that stands on a line of the sheet: three triangles at one side, which is a border for all.
  EXPECT_GT(with({{1.5f, 1, 1.5f}}, {{84, 85, 169}}), alone);
}

TEST(FlatPatches, NoFanIsNarrow) {
  const auto shape = [](glm::dvec2 a, glm::dvec2 b, glm::dvec2 c) {
    const double longest2 = std::max({glm::dot(b - a, b - a), glm::dot(c - b, c - b), glm::dot(a - c, a - c)});
    return ((b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)) / longest2;
  };
  const TriangleMesh mesh = sheet(24, [](float a, float b) { return glm::vec3(10 * a, 0, b); });
  FlatPatch patch;
  for (const glm::vec3 at : mesh.vertices) {
    patch.vertices.emplace_back(at.x, at.z);
    patch.is_border.push_back(at.x == 0 || at.x == 10 || at.z == 0 || at.z == 1);
  }
  for (const glm::uvec3 t : mesh.triangles) patch.triangles.push_back({t.x, t.y, t.z});
  collapse_inner_vertices(patch);
  EXPECT_LT(patch.triangles.size(), 300u);
  double area_m2 = 0;
  for (const auto& t : patch.triangles) {
    const glm::dvec2 a = patch.vertices[t[0]], b = patch.vertices[t[1]], c = patch.vertices[t[2]];
    EXPECT_GT(shape(a, b, c), 0.009);
    area_m2 += 0.5 * ((b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x));
  }
  EXPECT_NEAR(area_m2, 10.0, 1e-9);
}

// What rays meet: every triangle of the mesh against the patches, in a furnished house cut into pieces of 12 cm.
TEST(FlatPatches, RaysMeetTheSameHouse) {
  const Scene scene = load_scene("house:7,rooms=3,area_m2=40,detail_m=0.12");
  const TriangleMesh& mesh = scene.mesh();
  const EmbreeScene all(mesh.vertices, mesh.triangles);
  EXPECT_LT(3 * scene.rays().num_triangles(), 2 * all.num_triangles());
  const glm::vec3 size = scene.bounds().upper - scene.bounds().lower;
  int hits = 0, elsewhere = 0;
  for (std::uint32_t i = 0; i < 50'000; ++i) {
    const auto u = RandomStream(3, Purpose::test, i).uniform4(0), w = RandomStream(3, Purpose::test, i).uniform4(1);
    const glm::vec3 origin = scene.bounds().lower + glm::vec3(u[0], u[1], u[2]) * size;
    const float z = 2 * w[0] - 1, angle = 6.2831853f * w[1], r = std::sqrt(std::max(0.f, 1 - z * z));
    const glm::vec3 direction(r * std::cos(angle), z, r * std::sin(angle));
    const Hit of_all = all.intersect(origin, direction), of_patches = scene.rays().intersect(origin, direction);
    ASSERT_EQ(of_all.valid(), of_patches.valid()) << i;
    if (!of_all.valid()) continue;
    ++hits;
    // Where two surfaces meet, rounding decides which is hit.
    const bool is_equal = std::fabs(of_all.distance_m - of_patches.distance_m) < 1e-4f &&
                          glm::dot(of_all.normal, of_patches.normal) > 0.9999f &&
                          mesh.triangle_material[of_all.triangle] == mesh.triangle_material[of_patches.triangle] &&
                          mesh.triangle_object[of_all.triangle] == mesh.triangle_object[of_patches.triangle];
    if (!is_equal) {
      ++elsewhere;
      EXPECT_LT(glm::distance(of_all.position, of_patches.position), 1e-3f) << i;
    }
    EXPECT_LT(glm::distance(of_patches.position, origin + of_patches.distance_m * direction), 2e-4f) << i;
  }
  EXPECT_GT(hits, 40'000);
  EXPECT_LT(elsewhere, hits / 1000);
}

// A cube of 3 m cut into 1 : 20, turned and moved so that no wall is flat to the last bit.  Bounces in all directions from where rays meet
// the walls: none may get out.
TEST(FlatPatches, ATurnedRoomKeepsItsRays) {
  constexpr int n = 20;
  const glm::vec3 u = glm::normalize(glm::vec3(0.6f, 0.3f, -0.5f)), v = glm::normalize(glm::cross(u, glm::vec3(0.2f, 1.f, 0.1f))),
                  w = glm::cross(u, v), corner(17, -6, 31);
  TriangleMesh mesh;
  std::map<std::array<int, 3>, std::uint32_t> index_of;
  const auto vertex = [&](std::array<int, 3> at) {
    const auto [found, is_new] = index_of.try_emplace(at, static_cast<std::uint32_t>(mesh.vertices.size()));
    const auto along = [](int i) { return 3.f * static_cast<float>(i) / n; };
    if (is_new) mesh.vertices.push_back(corner + along(at[0]) * u + along(at[1]) * v + along(at[2]) * w);
    return found->second;
  };
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (const int side : {0, n})
      for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) {
          std::array<std::uint32_t, 4> c{};
          for (int k = 0; k < 4; ++k) {
            std::array<int, 3> at{};
            at[axis] = side;
            at[(axis + 1) % 3] = i + (k == 1 || k == 2);
            at[(axis + 2) % 3] = j + (k >= 2);
            c[static_cast<std::size_t>(k)] = vertex(at);
          }
          if (side == n) std::swap(c[1], c[3]);
          mesh.triangles.emplace_back(c[0], c[1], c[2]);
          mesh.triangles.emplace_back(c[0], c[2], c[3]);
        }
  mesh.triangle_material.assign(mesh.triangles.size(), 0);
  mesh.triangle_object.assign(mesh.triangles.size(), 0);
  mesh.material_names = mesh.object_names = {"wall"};
  const Scene scene("turned cube", mesh, {Material::uniform("wall", 0.1f, 0.5f)}, Air{});
  EXPECT_LT(3 * scene.rays().num_triangles(), mesh.triangles.size());
  const glm::vec3 middle = corner + 1.5f * (u + v + w);
  glm::vec3 origin = middle, direction = u;
  int escapes = 0;
  for (std::uint32_t bounce = 0; bounce < 400'000; ++bounce) {
    const Hit hit = scene.rays().intersect(origin, direction);
    const glm::vec3 from = hit.valid() ? hit.position - middle : glm::vec3(0);
    if (!hit.valid() || std::max({std::fabs(glm::dot(from, u)), std::fabs(glm::dot(from, v)), std::fabs(glm::dot(from, w))}) > 1.501f) {
      ++escapes;
      origin = middle;
      continue;
    }
    ASSERT_LE(glm::dot(hit.normal, direction), 0.f);
    origin = offset_from_surface(hit.position, hit.normal);
    // Uniform over the half space, grazing directions too.
    const auto x = RandomStream(5, Purpose::test, bounce).uniform4(0);
    const float z = 2 * x[0] - 1, r = std::sqrt(std::max(0.f, 1 - z * z));
    direction = {r * std::cos(6.2831853f * x[1]), z, r * std::sin(6.2831853f * x[1])};
    if (glm::dot(direction, hit.normal) < 0) direction = -direction;
  }
  EXPECT_EQ(escapes, 0);
}

}  // namespace
}  // namespace earshot
