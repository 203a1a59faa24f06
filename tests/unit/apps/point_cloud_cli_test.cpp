// SPDX-License-Identifier: Apache-2.0
// A point cloud in place of a scene, as a user types it.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

#include "sim/base/text/json.h"
#include "sim/scene/generators/shoebox.h"
#include "tests/support/files/cloud_files.h"
#include "tests/support/programs/cli.h"

namespace earshot {
namespace {

using testing::HasSubstr;
using testing::Not;

class PointCloudCli : public Cli {
 protected:
  /// A box of 6 x 3 x 5 m without a disc of 0.4 m in the wall x = 0.
  [[nodiscard]] static Points box() {
    Points points = sample_surface(make_shoebox({6, 3, 5}), 60'000, 0.005, 1);
    std::erase_if(points, [](glm::dvec3 p) { return glm::distance(p, glm::dvec3(0, 1.5, 2.5)) < 0.4; });
    return points;
  }
  [[nodiscard]] nlohmann::json report_of(const std::string& scene, std::string* output = nullptr) const {
    const CliOutcome outcome = earshot("scene " + scene + " --json " + file("s.json"));
    EXPECT_EQ(outcome.exit_code, 0) << scene << "\n" << outcome.errors;
    if (output) *output = outcome.output;
    return nlohmann::json::parse(read("s.json"));
  }
};

TEST_F(PointCloudCli, TheReportSaysHowPointsBecameASurface) {
  const Points points = box();
  const std::string cloud = write("box.ply", ply_points(points));
  std::string output;
  const nlohmann::json report = report_of(cloud + " --cell 0.1", &output);
  EXPECT_THAT(output, HasSubstr("cell 0.1 m (given)"));
  EXPECT_THAT(output, HasSubstr("closed holes     1, "));
  EXPECT_EQ(report.at("open_edges"), 0);
  EXPECT_NEAR(report.at("volume_m3").get<double>(), 90, 2.7);
  const nlohmann::json& made = report.at("cloud");
  EXPECT_EQ(made.at("points"), points.size());
  EXPECT_EQ(made.at("holes"), 1);
  EXPECT_NEAR(made.at("hole_area_m2").get<double>(), 0.503, 0.15);
  EXPECT_TRUE(made.at("spacing_m").is_null());
  // The same by the text of the SCENE and by a YAML.
  write("box.yaml", "mesh: box.ply\ncell_m: 0.1\n");
  for (const std::string& scene : {cloud + ",cell=0.1", file("box.yaml")}) EXPECT_EQ(report_of(scene).at("cloud"), made) << scene;
  EXPECT_TRUE(report_of("shoebox:6x3x5").at("cloud").is_null());
}

TEST_F(PointCloudCli, WithoutACellTheSpacingDecidesAndOneLineSaysSo) {
  const std::string cloud = write("box.xyz", xyz_points(box()));
  const std::string rir = "rir " + cloud + " --source 1,1.2,1 --listener 4,1.5,3 --preset fast --channels mono --out " + file("x.wav");
  const CliOutcome without = earshot(rir), with = earshot(rir + " --cell 0.1");
  EXPECT_EQ(without.exit_code, 0) << without.errors;
  EXPECT_EQ(with.exit_code, 0) << with.errors;
  EXPECT_THAT(without.errors, HasSubstr("no cell is given"));
  EXPECT_THAT(with.errors, Not(HasSubstr("no cell is given")));
  const nlohmann::json report = report_of(cloud);
  EXPECT_NEAR(report.at("cloud").at("cell_m").get<double>(), 5 * report.at("cloud").at("spacing_m").get<double>(), 0.006);
  const CliOutcome picture = earshot("render " + cloud + " --cell 0.1 --sensor depth --size 16x16 --pose 3,1.5,2,0 --out " + file("x.png"));
  EXPECT_EQ(picture.exit_code, 0) << picture.errors;
}

TEST_F(PointCloudCli, WhatIsWrongIsSaidInOneLine) {
  const std::string cloud = write("box.pcd", pcd_points(box(), "binary_compressed"));
  expect_bad_input("scene " + cloud + ",cell=0.1 --cell 0.1", "give it once");
  expect_bad_input("scene " + cloud + " --cell 0", "cell");
  expect_bad_input("scene " + cloud + ",cell=wide", "cell");
  expect_bad_input("scene shoebox:6x3x5 --cell 0.1", "takes no cell");
  expect_bad_input("scene " + write("box.laz", "LASF") + " --cell 0.1", "LAZ");
  expect_bad_input("scene " + write("mesh.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n") + " --cell 0.1", "takes no cell");
  expect_bad_input("scene " + write("cut.pcd", pcd_points(box(), "binary").substr(0, 5000)) + " --cell 0.1", "ends before");
}

}  // namespace
}  // namespace earshot
