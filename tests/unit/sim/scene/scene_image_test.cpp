// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/scene_image.h"

#include <gtest/gtest.h>

#include <bit>
#include <cstdint>
#include <string>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "tests/support/files/mutate.h"

namespace earshot {
namespace {

/// Everything that rays tell: distances, places and triangles, to the bit.
std::vector<std::uint32_t> bits_of_rays(const Scene& scene, int count = 2000) {
  std::vector<std::uint32_t> bits;
  const glm::vec3 lower = scene.bounds().lower, size = scene.bounds().upper - lower;
  for (int i = 0; i < count; ++i) {
    const RandomStream random(5, Purpose::test, static_cast<std::uint32_t>(i));
    const auto place = [&](std::uint32_t draw) {
      return lower + size * glm::vec3(random.uniform(draw), random.uniform(draw + 1), random.uniform(draw + 2));
    };
    const glm::vec3 from = place(0), to = place(3);
    const Hit hit = scene.rays().intersect(from, (to - from) / glm::length(to - from));
    for (const float value : {hit.distance_m, hit.position.x, hit.position.y, hit.position.z, hit.normal.x, hit.normal.y, hit.normal.z})
      bits.push_back(std::bit_cast<std::uint32_t>(value));
    bits.push_back(hit.triangle);
    bits.push_back(scene.rays().occluded(from, to) ? 1 : 0);
  }
  return bits;
}

TEST(SceneImage, TheSameSceneComesBack) {
  for (const char* spec : {"house:3,rooms=3,detail_m=0.3", "shoebox:6x3x4@0.2", "house:9,rooms=2,furnished=false"}) {
    const Scene scene = load_scene(spec);
    const Scene back = decode_scene(encode_scene(scene), "memory");
    EXPECT_EQ(back.name(), scene.name());
    EXPECT_EQ(back.hash(), scene.hash());
    EXPECT_EQ(back.mesh().vertices, scene.mesh().vertices);
    EXPECT_EQ(back.mesh().triangles, scene.mesh().triangles);
    EXPECT_EQ(back.mesh().object_names, scene.mesh().object_names);
    EXPECT_EQ(back.bounds().upper, scene.bounds().upper);
    EXPECT_EQ(back.speed_of_sound_m_per_s(), scene.speed_of_sound_m_per_s());
    EXPECT_EQ(back.rays().num_triangles(), scene.rays().num_triangles());
    EXPECT_EQ(bits_of_rays(back), bits_of_rays(scene)) << spec;
    EXPECT_EQ(encode_scene(back), encode_scene(scene)) << spec;
  }
}

TEST(SceneImage, MaterialsAndReportComeBackWhole) {
  TriangleMesh mesh;
  mesh.origin_m = {1e5, 0, -3};
  append_box(mesh, {0, 0, 0}, {4, 3, 5}, intern(mesh.material_names, "wall"), intern(mesh.object_names, "room"));
  Material wall = Material::uniform("wall", 0.25f, 0.5f, 0.125f);
  wall.labels = {"wall", "a label that is longer than a short string"};
  wall.absorption = {{125.f, 1000.f, 4000.f}, {0.1f, 0.2f, 0.3f}};
  wall.damping_db_per_m = {{500.f}, {2.f}};
  wall.speed_m_per_s = 3000;
  wall.density_kg_per_m3 = 700;
  wall.source = "a book";
  wall.sources = {{"absorption", "page 3"}, {"scattering", "page 4"}};
  wall.category = "wall";
  ImportReport report;
  report.triangles_read = 14;
  report.duplicate_removed = 2;
  report.simplified = SimplifyReport{.triangles_before = 20, .triangles_after = 14, .deviation_m = 0.01};
  report.warnings = {"odd"};
  report.choices = {{MaterialReason::category, "wall", true}};
  report.has_semantics = true;
  report.axes = FileAxes{.unit_m = 0.01, .up = 'z', .is_unit_given = true};
  report.cloud = CloudReport{.points = 7,
                             .invalid_points = 1,
                             .stray_points = 2,
                             .cell_m = 0.05,
                             .is_cell_given = true,
                             .spacing_m = 0.01,
                             .closed_width_m = 0.4,
                             .holes = 3,
                             .hole_area_m2 = 1.5,
                             .air_m3 = 60,
                             .unseen_m3 = 2};
  const Air air{.temperature_c = 10.f, .humidity_percent = 30.f, .speed_of_sound_m_per_s = 343.f};
  const Scene scene("a name", mesh, {wall}, air, report);
  const Scene back = decode_scene(encode_scene(scene), "memory");
  ASSERT_EQ(back.materials().size(), 1u);
  const Material& decoded = back.materials()[0];
  EXPECT_EQ(decoded.labels, wall.labels);
  EXPECT_EQ(decoded.absorption.hz, wall.absorption.hz);
  EXPECT_EQ(decoded.absorption.value, wall.absorption.value);
  EXPECT_EQ(decoded.transmission.value, wall.transmission.value);
  EXPECT_EQ(decoded.damping_db_per_m.value, wall.damping_db_per_m.value);
  EXPECT_EQ(decoded.speed_m_per_s, wall.speed_m_per_s);
  EXPECT_EQ(decoded.density_kg_per_m3, wall.density_kg_per_m3);
  EXPECT_EQ(decoded.source, wall.source);
  EXPECT_EQ(decoded.sources, wall.sources);
  EXPECT_EQ(decoded.category, wall.category);
  EXPECT_EQ(back.air().temperature_c, 10.f);
  EXPECT_EQ(back.speed_of_sound_m_per_s(), 343.f);
  EXPECT_EQ(back.origin_m(), mesh.origin_m);
  EXPECT_EQ(back.import_report().triangles_read, 14u);
  EXPECT_EQ(back.import_report().duplicate_removed, 2u);
  ASSERT_TRUE(back.import_report().simplified);
  EXPECT_EQ(back.import_report().simplified->triangles_before, 20u);
  EXPECT_EQ(back.import_report().simplified->deviation_m, 0.01);
  EXPECT_EQ(back.import_report().warnings, report.warnings);
  ASSERT_EQ(back.import_report().choices.size(), 1u);
  EXPECT_EQ(back.import_report().choices[0].reason, MaterialReason::category);
  EXPECT_EQ(back.import_report().choices[0].by, "wall");
  EXPECT_TRUE(back.import_report().choices[0].has_category);
  EXPECT_TRUE(back.import_report().has_semantics);
  ASSERT_TRUE(back.import_report().axes);
  EXPECT_EQ(back.import_report().axes->unit_m, 0.01);
  EXPECT_EQ(back.import_report().axes->up, 'z');
  EXPECT_TRUE(back.import_report().axes->is_unit_given);
  EXPECT_FALSE(back.import_report().axes->is_up_given);
  ASSERT_TRUE(back.import_report().cloud);
  EXPECT_EQ(back.import_report().cloud->points, 7u);
  EXPECT_EQ(back.import_report().cloud->stray_points, 2u);
  EXPECT_TRUE(back.import_report().cloud->is_cell_given);
  EXPECT_EQ(back.import_report().cloud->closed_width_m, 0.4);
  EXPECT_EQ(back.import_report().cloud->holes, 3u);
  EXPECT_EQ(back.import_report().cloud->unseen_m3, 2);
}

TEST(SceneImage, AnEmptySceneIsOneToo) {
  const Scene scene("nothing", TriangleMesh{}, {}, Air{});
  EXPECT_EQ(decode_scene(encode_scene(scene), "memory").hash(), scene.hash());
}

// What is read may be wrong where no check can tell (the text of a warning), but indices lie within their arrays and nothing else is
// thrown.
TEST(SceneImage, DamagedImagesAreRefusedOrUsable) {
  const std::string image = encode_scene(load_scene("shoebox:6x3x4@0.2"));
  int refused = 0;
  for (std::uint32_t number = 0; number < 4000; ++number) {
    try {
      const Scene scene = decode_scene(mutated(image, number), "memory");
      for (std::uint32_t i = 0; i < scene.rays().num_triangles(); ++i)
        ASSERT_LT(scene.rays().stands_for(i), scene.mesh().triangles.size()) << number;
      bits_of_rays(scene, 3);
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find("memory"), std::string::npos);
      ++refused;
    }
  }
  EXPECT_GT(refused, 2000);
  for (std::size_t size = 0; size < image.size(); size += 7) EXPECT_THROW(decode_scene(image.substr(0, size), "cut"), InputError);
}

// Bytes that Embree and the arrays take: a second scene as large as the first must come out as large.
TEST(SceneImage, BytesCountTheMeshAndTheRayStructure) {
  const Scene small = load_scene("shoebox:6x3x4@0.2"), large = load_scene("house:3,rooms=4,detail_m=0.15");
  const std::size_t triangles = large.mesh().triangles.size(), traced = large.rays().num_triangles();
  // At least the data of hits and the indices of traced triangles, and the mesh; at most what a tree of one node per triangle would add.
  EXPECT_GT(large.bytes(), 20 * triangles + (64 + 12) * traced);
  EXPECT_LT(large.bytes(), 60 * triangles + 600 * traced);
  EXPECT_LT(small.bytes(), std::size_t{1} << 19);
  EXPECT_GT(small.rays().bytes(), std::size_t{12} * 64);
}

}  // namespace
}  // namespace earshot
