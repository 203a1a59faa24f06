// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/scene_report.h"

#include <gtest/gtest.h>

#include <cmath>

#include "sim/scene/generators/shoebox.h"
#include "tests/support/files/test_files.h"
#include "tests/support/files/test_paths.h"

namespace earshot {
namespace {

Scene box_scene(glm::vec3 size_m, std::vector<std::uint32_t> left_out = {}, float absorption = 0.1f) {
  TriangleMesh mesh = make_shoebox(size_m);
  for (std::size_t i = left_out.size(); i-- > 0;) {
    const auto at = static_cast<std::ptrdiff_t>(left_out[i]);
    mesh.triangles.erase(mesh.triangles.begin() + at);
    mesh.triangle_material.erase(mesh.triangle_material.begin() + at);
    mesh.triangle_object.erase(mesh.triangle_object.begin() + at);
  }
  return Scene("box", std::move(mesh), std::vector<Material>(6, Material::uniform("m", absorption, 1)), Air{.speed_of_sound_m_per_s = 343});
}

// V and S of a box are known; RT60 by Eyring (Kuttruff eq. 5.24).  4096 walks of 32 paths, whose lengths spread by 0.6 of their mean:
// 0.6 / sqrt(131072) = 0.2 % standard error of S (more, as neighbouring paths depend on each other), tolerance four of them.
TEST(SceneReport, ClosedBoxHasItsVolumeAreaAndReverberation) {
  const glm::dvec3 size(6, 3, 4);
  const SceneReport report = report_scene(box_scene(size));
  const double volume = size.x * size.y * size.z, area = 2 * (size.x * size.y + size.y * size.z + size.z * size.x);
  EXPECT_EQ(report.triangles, 12u);
  EXPECT_EQ(report.open_edges, 0u);
  EXPECT_EQ(report.ray_efficiency, 1);
  EXPECT_EQ(report.leaked_ray_fraction, 0);
  EXPECT_NEAR(report.volume_m3, volume, 1e-4 * volume);
  EXPECT_NEAR(report.area_m2, area, 0.01 * area);
  ASSERT_EQ(report.rt60_estimate_s.size(), report_bands_hz.size());
  const double eyring_s = 24 * std::log(10.) / 343 * volume / (-area * std::log(0.9));
  for (const double rt60_s : report.rt60_estimate_s) EXPECT_NEAR(rt60_s, eyring_s, 0.01 * eyring_s);
}

TEST(SceneReport, AirShortensTheReverberation) {
  const Scene scene = box_scene({6, 3, 4});
  const std::array<double, 7> air{0, 0, 0, 0, 0, 0.01, 0.1};
  const SceneReport report = report_scene(scene, 0, air);
  const double volume = 72, area = 108;
  for (std::size_t band = 0; band < air.size(); ++band) {
    const double expected_s = 24 * std::log(10.) / 343 * volume / (4 * air[band] * volume - area * std::log(0.9));
    EXPECT_NEAR(report.rt60_estimate_s[band], expected_s, 0.01 * expected_s) << band;
  }
}

TEST(SceneReport, AbsorptionIsReadPerBand) {
  TriangleMesh mesh = make_shoebox({5, 3, 4});
  Material material = Material::uniform("m", 0, 1);
  material.absorption = {{125, 250, 500, 1000, 2000, 4000, 8000}, {0.5f, 0.5f, 0.5f, 0.2f, 0.05f, 0.05f, 0.05f}};
  const SceneReport report = report_scene(Scene("box", std::move(mesh), std::vector<Material>(6, material), Air{}));
  EXPECT_NEAR(report.rt60_estimate_s[6] / report.rt60_estimate_s[0], std::log(0.5) / std::log(0.95), 0.02);
}

TEST(SceneReport, ExtremeAbsorptionGivesNoNan) {
  for (const double rt60_s : report_scene(box_scene({6, 3, 4}, {}, 0)).rt60_estimate_s)
    EXPECT_EQ(rt60_s, std::numeric_limits<double>::infinity());
  for (const double rt60_s : report_scene(box_scene({6, 3, 4}, {}, 1)).rt60_estimate_s) EXPECT_EQ(rt60_s, 0);
}

// Without its ceiling a box loses the rays that go into the opening: from the point p the solid angle of the rectangle over 4 pi,
// averaged over the volume.  For a cube that is 1/6 by symmetry.
TEST(SceneReport, MissingCeilingLeaksASixthOfACube) {
  const SceneReport report = report_scene(box_scene({3, 3, 3}, {6, 7}));
  EXPECT_EQ(report.open_edges, 4u);
  EXPECT_NEAR(report.leaked_ray_fraction, 1. / 6, 0.012) << "four sigma of 16,384 rays";
  EXPECT_NEAR(report.volume_m3, 27, 1e-3) << "of the bounds";
  EXPECT_TRUE(std::isnan(report.area_m2));
  for (const double rt60_s : report.rt60_estimate_s) EXPECT_TRUE(std::isnan(rt60_s));
}

TEST(SceneReport, CountsTheSpaceAroundASolidOnly) {
  TriangleMesh mesh = make_shoebox({6, 3, 4});
  append_box(mesh, {2, 0.5f, 1}, {4, 2, 3}, 0, 0);  // a block of 2 x 1.5 x 2 in the air
  const SceneReport report = report_scene(Scene("box", std::move(mesh), std::vector<Material>(6, Material::uniform("m", 0.1f, 1)), Air{}));
  EXPECT_EQ(report.ray_efficiency, 1);
  EXPECT_NEAR(report.volume_m3, 72 - 6, 0.5);
  EXPECT_NEAR(report.area_m2, 108 + 2 * (2 * 1.5 + 1.5 * 2 + 2 * 2), 2.6) << "2 %: the volume's strata and the walk";
}

TEST(SceneReport, IsAFunctionOfSceneAndSeed) {
  const Scene scene = box_scene({6, 3, 4}, {7});
  const SceneReport a = report_scene(scene, 5), b = report_scene(scene, 5), c = report_scene(scene, 6);
  EXPECT_EQ(a.ray_efficiency, b.ray_efficiency);
  EXPECT_NE(a.ray_efficiency, c.ray_efficiency);
}

TEST(SceneReport, EmptySceneAndSingleTriangle) {
  const SceneReport empty = report_scene(Scene("empty", {}, {}, Air{}));
  EXPECT_EQ(empty.ray_efficiency, 0);
  EXPECT_EQ(empty.leaked_ray_fraction, 1);
  EXPECT_EQ(empty.volume_m3, 0);
  TriangleMesh mesh;
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 0, 1}};
  mesh.triangles = {{0, 1, 2}};
  mesh.triangle_material = mesh.triangle_object = {0};
  mesh.material_names = mesh.object_names = {"a"};
  const SceneReport report = report_scene(Scene("t", std::move(mesh), {Material::uniform("a", 0.5f, 0.5f)}, Air{}));
  EXPECT_EQ(report.open_edges, 3u);
  EXPECT_LE(report.ray_efficiency, 0.5);
}

TEST(SceneReport, SmallHouseLeaksUntilItGetsItsCeiling) {
  SKIP_WITHOUT_DATA("scenes/small_house.glb");
  const TempFolder folder;
  const std::string mesh = std::filesystem::absolute(data_folder() / "scenes/small_house.glb").string();
  const SceneReport open = report_scene(load_scene(mesh)),
                    closed = report_scene(load_scene(folder.write("s.yaml", "mesh: " + mesh + "\nceiling_m: 3\n")));
  EXPECT_GT(open.leaked_ray_fraction, 0.15);
  EXPECT_TRUE(std::isnan(open.rt60_estimate_s[3]));
  EXPECT_LT(closed.leaked_ray_fraction, 0.01);
  EXPECT_GT(closed.rt60_estimate_s[3], 0.1);
  EXPECT_LT(closed.volume_m3, 19.1 * 11.5 * 3);
}

TEST(SmallHouseYaml, AssignsEveryPattern) {
  const auto yaml = source_dir() / "configs/scenes/small_house.yaml";  // names its mesh by a relative path
  const auto mesh = yaml.parent_path() / "../../../shared/data/scenes/small_house.glb";
  if (!std::filesystem::exists(mesh)) GTEST_SKIP() << "no test data: " << mesh.string();
  const Scene house = load_scene(yaml.string());
  EXPECT_TRUE(house.import_report().warnings.empty()) << house.import_report().warnings[0];
  const auto hit = [&](glm::vec3 from, glm::vec3 direction) {
    const Hit found = house.rays().intersect(from, direction);
    return found.valid() ? house.materials()[house.mesh().triangle_material[found.triangle]].name : std::string("nothing");
  };
  EXPECT_EQ(hit({0, 2.9f, 0}, {0, 1, 0}), "plaster_ceiling");
}

}  // namespace
}  // namespace earshot
