// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/point_cloud/cloud_import.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <string>

#include "sim/base/errors.h"
#include "sim/scene/generators/house_generator.h"
#include "sim/scene/generators/shoebox.h"
#include "sim/scene/scene.h"
#include "tests/support/files/cloud_files.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;

double draw_of(std::uint32_t room, std::uint32_t index) {
  return static_cast<double>(RandomStream(37, Purpose::test, room).uniform(index));
}

void turn(Points& points, double angle, glm::dvec3 shift) {
  for (glm::dvec3& p : points)
    p = shift + glm::dvec3(p.x * std::cos(angle) - p.z * std::sin(angle), p.y, p.x * std::sin(angle) + p.z * std::cos(angle));
}

std::uint64_t open_edges_of(const TriangleMesh& mesh) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
  for (const glm::uvec3 t : mesh.triangles)
    for (int corner = 0; corner < 3; ++corner) ++edges[std::minmax(t[corner], t[(corner + 1) % 3])];
  return static_cast<std::uint64_t>(std::ranges::count_if(edges, [](const auto& edge) { return edge.second < 2; }));
}

/// Signed volumes of closed parts add up to the air between them (divergence theorem).
double volume_of(const TriangleMesh& mesh) {
  double volume = 0;
  for (const glm::uvec3 t : mesh.triangles)
    volume += glm::dot(glm::dvec3(mesh.vertices[t.x]), glm::cross(glm::dvec3(mesh.vertices[t.y]), glm::dvec3(mesh.vertices[t.z]))) / 6;
  return std::fabs(volume);
}

std::string cloud_refusal_of(const std::string& path, const MeshImportOptions& options = {}) {
  try {
    import_point_cloud(path, options);
  } catch (const InputError& error) {
    return error.what();
  }
  return "no refusal";
}

// Noise of 1 cm moves no plane: the volume is that of the box within 2 % however it lies, and the surface has no edge of its own.
TEST(CloudImport, ABoxOfAnySizeAndHeadingKeepsItsVolume) {
  const TempFolder folder;
  for (std::uint32_t room = 0; room < 6; ++room) {
    const glm::dvec3 size(3 + 5 * draw_of(room, 0), 2.3 + 2 * draw_of(room, 1), 3 + 5 * draw_of(room, 2));
    Points points = sample_surface(make_shoebox(size), 100'000, 0.01, room);
    turn(points, room == 0 ? 0 : 2 * std::numbers::pi * draw_of(room, 3), {1e4 * draw_of(room, 4), -3, 20});
    MeshImportOptions options;
    if (room % 2 == 0) options.cell_m = 0.06 + 0.06 * draw_of(room, 5);
    const ImportedMesh imported = import_point_cloud(folder.write("box.ply", ply_points(points, "ascii", "double")), options);
    ASSERT_TRUE(imported.report.cloud);
    const CloudReport& cloud = *imported.report.cloud;
    const double volume = size.x * size.y * size.z;
    EXPECT_NEAR(cloud.air_m3, volume, 0.02 * volume) << room;
    EXPECT_NEAR(volume_of(imported.mesh), cloud.air_m3, 1e-3 * volume);
    EXPECT_EQ(open_edges_of(imported.mesh), 0u) << room;
    EXPECT_LT(cloud.hole_area_m2, 0.5);
    EXPECT_EQ(cloud.points, points.size());
    EXPECT_EQ(cloud.is_cell_given, room % 2 == 0);
    EXPECT_EQ(imported.report.warnings.size(), room % 2 == 0 ? 0u : 1u);
    for (const std::string& warning : imported.report.warnings) EXPECT_THAT(warning, HasSubstr("no cell is given"));
    for (const std::string& name : imported.mesh.material_names)
      EXPECT_THAT(name, testing::AnyOf("facing_up", "facing_down", "upright", "closed_hole"));
    double floor_m2 = 0, inverted_m2 = 0;  // where noise folds a wall, a triangle may face the other way
    for (std::size_t t = 0; t < imported.mesh.triangles.size(); ++t) {
      const std::string& name = imported.mesh.material_names[imported.mesh.triangle_material[t]];
      if (name != "facing_up" && name != "facing_down") continue;
      const glm::uvec3 corners = imported.mesh.triangles[t];
      const glm::dvec3 a(imported.mesh.vertices[corners.x]), b(imported.mesh.vertices[corners.y]), c(imported.mesh.vertices[corners.z]);
      const double area_m2 = glm::length(glm::cross(b - a, c - a)) / 2;
      const bool is_low = (a.y + b.y + c.y) / 3 + imported.mesh.origin_m.y < -3 + size.y / 2;
      if (is_low != (name == "facing_up")) inverted_m2 += area_m2;
      if (name == "facing_up") floor_m2 += area_m2;
    }
    EXPECT_LE(inverted_m2, 0.01 * size.x * size.z) << room;
    EXPECT_NEAR(floor_m2, size.x * size.z, 0.1 * size.x * size.z) << room;
  }
}

// Rooms, doors, thick walls, furniture: the air of the house within 5 %.
TEST(CloudImport, AHouseKeepsItsVolume) {
  const TempFolder folder;
  for (const std::uint64_t seed : {3u, 5u}) {
    HouseConfig config{.seed = seed};
    config.rooms = 3;
    config.area_m2 = 40;
    const TriangleMesh house = generate_house(config);
    const Points points = sample_surface(house, 200'000, 0.01, static_cast<std::uint32_t>(seed));
    const ImportedMesh imported = import_point_cloud(folder.write("house.ply", ply_points(points)), {.cell_m = 0.1});
    const double volume = volume_of(house);
    EXPECT_NEAR(imported.report.cloud->air_m3, volume, 0.05 * volume) << seed;
    EXPECT_EQ(open_edges_of(imported.mesh), 0u) << seed;
    EXPECT_GT(imported.report.cloud->unseen_m3, 0) << "the inside of walls and furniture";
  }
}

// Round holes in three walls, drawn: each is closed by a membrane of its size, reported, and changes no volume.
TEST(CloudImport, HolesAreClosedAndReported) {
  const TempFolder folder;
  for (std::uint32_t room = 10; room < 14; ++room) {
    const glm::dvec3 size(6, 3, 5);
    Points points = sample_surface(make_shoebox(size), 100'000, 0.005, room);
    double area = 0, widest = 0;
    for (std::uint32_t axis = 0; axis < 3; ++axis) {
      const double radius = 0.3 + 0.4 * draw_of(room, 10 * axis);
      glm::dvec3 centre;
      for (std::uint32_t other = 0; other < 3; ++other)
        centre[static_cast<glm::length_t>(other)] =
            1.2 + (size[static_cast<glm::length_t>(other)] - 2.4) * draw_of(room, 10 * axis + 1 + other);
      centre[static_cast<glm::length_t>(axis)] = draw_of(room, 10 * axis + 5) < 0.5 ? 0 : size[static_cast<glm::length_t>(axis)];
      std::erase_if(points, [&](glm::dvec3 p) { return glm::distance(p, centre) < radius; });
      area += std::numbers::pi * radius * radius;
      widest = std::max(widest, 2 * radius);
    }
    turn(points, room % 2 == 0 ? 0 : draw_of(room, 50), {0, 0, 0});
    const ImportedMesh imported = import_point_cloud(folder.write("holes.ply", ply_points(points)), {.cell_m = 0.08});
    const CloudReport& cloud = *imported.report.cloud;
    EXPECT_NEAR(cloud.air_m3, 90, 0.03 * 90) << room;
    EXPECT_EQ(open_edges_of(imported.mesh), 0u) << room;
    EXPECT_EQ(cloud.holes, 3u) << room;
    EXPECT_NEAR(cloud.hole_area_m2, area, 0.3 * area) << room;
    EXPECT_GE(cloud.closed_width_m, 0.7 * widest);
    EXPECT_LE(cloud.closed_width_m, 2.5 * widest);
    EXPECT_NEAR(std::remainder(std::log2(cloud.closed_width_m / 0.16), 1), 0, 1e-6) << "a power of two of cells";
    ASSERT_EQ(imported.report.warnings.size(), 1u) << room;
    EXPECT_THAT(imported.report.warnings.front(), HasSubstr("3 holes"));
  }
}

TEST(CloudImport, StrayPointsAreLeftOut) {
  const TempFolder folder;
  Points points = sample_surface(make_shoebox({6, 3, 5}), 60'000, 0.005, 4);
  for (std::uint32_t i = 0; i < 30; ++i) points.emplace_back(3 + 2 * draw_of(i, 0), 1.5 + 0.5 * draw_of(i, 1), i < 20 ? 2.5 : 40. + i);
  const ImportedMesh imported = import_point_cloud(folder.write("stray.ply", ply_points(points)), {.cell_m = 0.1});
  EXPECT_GE(imported.report.cloud->stray_points, 10u);
  EXPECT_NEAR(imported.report.cloud->air_m3, 90, 2);
}

// The unit, the up axis and the cell of a SCENE text are those of the options; a LAS stands upright by itself.
TEST(CloudImport, AScenesTextNamesUnitAxisAndCell) {
  const TempFolder folder;
  const glm::dvec3 size(5, 3, 4);
  Points points = sample_surface(make_shoebox(size), 60'000, 0.005, 6), in_file;
  for (const glm::dvec3 p : points) in_file.push_back(glm::dvec3(p.x, -p.z, p.y) * 100.);
  const std::string path = folder.write("box.ply", ply_points(in_file));
  const Scene scene = load_scene(path + ",unit=0.01,up=z,cell=0.1");
  ASSERT_TRUE(scene.import_report().cloud);
  EXPECT_NEAR(scene.import_report().cloud->air_m3, 60, 1.2);
  EXPECT_EQ(scene.import_report().cloud->cell_m, 0.1);
  EXPECT_NEAR(scene.bounds().upper.y, 3, 0.1);
  const Scene overridden = load_scene(path, {.unit_m = 0.01, .simplify_m = {}, .up = MeshImportOptions::Up::z, .cell_m = 0.1});
  EXPECT_EQ(overridden.hash(), scene.hash());
  const std::string yaml = folder.write("box.yaml", "mesh: box.ply\nunit_m: 0.01\nup: z\ncell_m: 0.1\n");
  EXPECT_EQ(load_scene(yaml).hash(), scene.hash());

  Points upright;
  for (const glm::dvec3 p : points) upright.push_back(glm::round(glm::dvec3(p.x, -p.z, p.y) * 1024.) / 1024.);
  const Scene las = load_scene(folder.write("box.las", las_points(upright, 4, 6)) + ",cell=0.1");
  EXPECT_NEAR(las.bounds().upper.y, 3, 0.1);
  EXPECT_NEAR(las.import_report().cloud->air_m3, 60, 1.2);
}

TEST(CloudImport, WhatCannotBeMadeIsRefusedByName) {
  const TempFolder folder;
  const Points box = sample_surface(make_shoebox({6, 3, 5}), 30'000, 0.005, 7);
  Points floor = box;
  std::erase_if(floor, [](glm::dvec3 p) { return p.y > 0.1; });
  EXPECT_THAT(cloud_refusal_of(folder.write("floor.ply", ply_points(floor)), {.cell_m = 0.1}), HasSubstr("encloses no air"));
  EXPECT_THAT(cloud_refusal_of(folder.write("sparse.ply", ply_points(Points(box.begin(), box.begin() + 9))), {.cell_m = 0.1}),
              HasSubstr("too sparse for a cell of 0.1 m"));
  EXPECT_THAT(cloud_refusal_of(folder.write("one.ply", ply_points({{1, 2, 3}}))), HasSubstr("too sparse"));
  Points far = box;
  for (const glm::dvec3 p : box) far.push_back(p + 9000.);
  EXPECT_THAT(cloud_refusal_of(folder.write("far.ply", ply_points(far)), {.cell_m = 0.1}), HasSubstr("blocks of 512 voxels"));
  EXPECT_THAT(cloud_refusal_of(folder.write("far.ply", ply_points(far)), {.cell_m = 0.001}), HasSubstr("cells of 0.001 m"));
  Points beyond = box;
  beyond.emplace_back(2e9, 0, 0);
  EXPECT_THAT(cloud_refusal_of(folder.write("beyond.ply", ply_points(beyond, "ascii", "double"))), HasSubstr("farther than"));
  const std::string faces = folder.write("mesh.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  for (const std::string& scene :
       {faces + ",cell=0.1", folder.write("a.ply", ply_points(box)) + ",cell=0", folder / "a.ply,cell=0.1,cell=0.1"})
    EXPECT_THROW(load_scene(scene), InputError) << scene;
}

}  // namespace
}  // namespace earshot
