// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/point_cloud/point_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <map>
#include <string>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/scene/point_cloud/lzf.h"
#include "tests/support/files/cloud_files.h"
#include "tests/support/files/mutate.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using testing::HasSubstr;

/// Multiples of 1/1024 m within 8 m: floats, LAS integers and decimal text hold them exactly.
Points drawn_points(std::size_t count, std::uint32_t seed) {
  Points points;
  for (std::uint32_t i = 0; i < count; ++i) {
    const RandomStream random(seed, Purpose::test, i);
    points.emplace_back(glm::dvec3(random.below(16384, 0), random.below(16384, 1), random.below(16384, 2)) / 1024. - 8.);
  }
  return points;
}

/// The same points in every format that is read, by the name of the file.
std::map<std::string, std::string> files_of(const Points& points) {
  std::map<std::string, std::string> files;
  for (const std::string format : {"ascii", "binary_little_endian", "binary_big_endian"})
    for (const std::string type : {"float", "double"}) files[format + "_" + type + ".ply"] = ply_points(points, format, type);
  for (const std::string data : {"ascii", "binary", "binary_compressed"})
    for (const std::size_t size : {4u, 8u}) files[fmt::format("{}_{}.pcd", data, size)] = pcd_points(points, data, size);
  files["blanks.xyz"] = xyz_points(points);
  files["tabs.asc"] = xyz_points(points, "\t", "# a comment\n// X Y Z R\n\n");
  files["commas.xyz"] = xyz_points(points, ",");
  files["spaced_commas.XYZ"] = xyz_points(points, ", ");
  files["semicolons.xyz"] = xyz_points(points, ";", "\"X\";\"Y\";\"Z\";\"I\"\n");
  files["count.pts"] = xyz_points(points, " ", fmt::format("{}\r\n", points.size()));
  std::string swapped = "intensity z x y\n";
  for (const glm::dvec3 p : points) swapped += fmt::format("5 {} {} {}\n", p.z, p.x, p.y);
  files["named_columns.xyz"] = swapped;
  for (int minor = 2; minor <= 4; ++minor)
    for (int format = 0; format <= (minor == 2 ? 3 : minor == 3 ? 5 : 10); ++format)
      files[fmt::format("1_{}_format_{}.las", minor, format)] = las_points(points, minor, format);
  return files;
}

std::string refusal_of(const std::string& path) {
  try {
    read_point_file(path);
  } catch (const InputError& error) {
    return error.what();
  }
  return "no refusal";
}

TEST(PointFiles, EveryFormatHoldsTheSamePoints) {
  const TempFolder folder;
  for (const std::size_t count : {1u, 2u, 100u, 3000u}) {
    const Points points = drawn_points(count, static_cast<std::uint32_t>(count));
    for (const auto& [name, bytes] : files_of(points)) {
      const std::string path = folder.write(name, bytes);
      ASSERT_TRUE(is_point_cloud(path)) << name;
      const PointCloud cloud = read_point_file(path);
      EXPECT_EQ(cloud.positions, points) << name;
      EXPECT_EQ(cloud.num_invalid, 0u) << name;
    }
  }
}

TEST(PointFiles, PackedBytesComeBack) {
  for (std::uint32_t i = 0; i < 200; ++i) {
    const RandomStream random(5, Purpose::test, i);
    // Few letters make long references, many make literals.
    const std::uint32_t letters = 1 + random.below(8, 0), size = random.below(3000, 1);
    std::string bytes;
    for (std::uint32_t at = 0; at < size; ++at) bytes += static_cast<char>(random.below(letters, 2 + at));
    const std::string packed = packed_lzf(bytes);
    EXPECT_EQ(expand_lzf(packed, size), bytes);
    EXPECT_EQ(expand_lzf(packed, size + 1), std::nullopt);
    if (size > 0) {
      EXPECT_EQ(expand_lzf(packed, size - 1), std::nullopt);
      EXPECT_EQ(expand_lzf(packed.substr(0, packed.size() - 1), size), std::nullopt);
    }
  }
}

TEST(PointFiles, AMeshIsNoCloud) {
  const TempFolder folder;
  const std::string header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
  const std::string vertices = "0 0 0\n1 0 0\n0 1 0\n";
  EXPECT_FALSE(is_point_cloud(
      folder.write("mesh.ply", header + "element face 1\nproperty list uchar int vertex_indices\nend_header\n" + vertices + "3 0 1 2\n")));
  EXPECT_TRUE(is_point_cloud(
      folder.write("cloud.ply", header + "element face 0\nproperty list uchar int vertex_indices\nend_header\n" + vertices)));
  EXPECT_FALSE(is_point_cloud(folder.write("cut.ply", header)));
  EXPECT_FALSE(is_point_cloud(folder.write("mesh.obj", "v 0 0 0\n")));
  EXPECT_FALSE(is_point_cloud(folder / "absent.ply"));
}

TEST(PointFiles, PointsThatAreNotFiniteAreLeftOut) {
  const TempFolder folder;
  Points points = drawn_points(50, 7);
  const Points whole = points;
  const double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
  points.insert(points.begin() + 10, {nan, 0, 0});
  points.insert(points.begin() + 20, {0, infinity, 0});
  points.emplace_back(0, 0, nan);
  for (const auto& [name, bytes] : files_of(points)) {
    if (name.ends_with(".las")) continue;
    const PointCloud cloud = read_point_file(folder.write(name, bytes));
    EXPECT_EQ(cloud.positions, whole) << name;
    EXPECT_EQ(cloud.num_invalid, 3u) << name;
  }
}

TEST(PointFiles, WithheldPointsAndNoiseOfALasAreLeftOut) {
  const TempFolder folder;
  const Points points = drawn_points(10, 8);
  for (const int format : {0, 3, 6, 10}) {
    std::string bytes = las_points(points, 4, format);
    const std::size_t record = (bytes.size() - 385) / points.size();
    const auto byte = [&](std::size_t point, std::size_t at) -> char& { return bytes[385 + point * record + at]; };
    if (format < 6) {
      byte(1, 15) = static_cast<char>(0x80 | 2);
      byte(4, 15) = 7;
      byte(5, 15) = 0x20 | 2;  // synthetic: stays
    } else {
      byte(1, 15) = 4;
      byte(4, 16) = 18;
      byte(5, 16) = 2;
    }
    const PointCloud cloud = read_point_file(folder.write("a.las", bytes));
    EXPECT_EQ(cloud.num_invalid, 2u);
    Points left = points;
    left.erase(left.begin() + 4);
    left.erase(left.begin() + 1);
    EXPECT_EQ(cloud.positions, left);
  }
}

TEST(PointFiles, WhatIsNotReadIsNamed) {
  const TempFolder folder;
  const Points points = drawn_points(20, 9);
  const auto refused = [&](const std::string& name, const std::string& bytes) { return refusal_of(folder.write(name, bytes)); };
  EXPECT_THAT(refused("a.laz", las_points(points, 4, 6)), HasSubstr("LAZ"));
  std::string las = las_points(points, 4, 6);
  las[104] = static_cast<char>(las[104] | 0x80);
  EXPECT_THAT(refused("packed.las", las), HasSubstr("LAZ"));
  las[104] = 11;
  EXPECT_THAT(refused("format.las", las), HasSubstr("point format 11"));
  las[24] = 2;
  EXPECT_THAT(refused("version.las", las), HasSubstr("version 2.4"));
  std::string pcd = pcd_points(points, "ascii");
  EXPECT_THAT(refused("data.pcd", pcd.replace(pcd.find("DATA ascii"), 10, "DATA zipped")), HasSubstr("DATA zipped"));
  EXPECT_THAT(refused("fields.pcd", "VERSION .7\nFIELDS x y\nSIZE 4 4\nTYPE F F\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\n1 2\n"),
              HasSubstr("x, y and z"));
  EXPECT_THAT(refused("many.pcd", "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 99999999999\nHEIGHT 1\nDATA binary\n"),
              HasSubstr(std::to_string(kMaxPoints)));
  EXPECT_THAT(refused("names.xyz", "a b c\n1 2 3\n"), HasSubstr("line 1"));
  EXPECT_THAT(refused("words.xyz", "1 2 3\n1 2 three\n"), HasSubstr("line 2"));
  EXPECT_THAT(refused("columns.xyz", "1 2 3\n\n1 2\n"), HasSubstr("line 3"));
  EXPECT_THAT(refused("count.pts", "3\n1 2 3\n1 2 4\n"), HasSubstr("declares 3 points, but holds 2"));
  EXPECT_THAT(refused("empty.xyz", ""), HasSubstr("no points"));
  EXPECT_THAT(refused("nan.xyz", "nan nan nan\n"), HasSubstr("no points"));
}

// The bytes of all points do not fit into 64 bits: 2^38 a point, by 2^26 points.
TEST(PointFiles, APcdOfEndlessPointsIsRefused) {
  const TempFolder folder;
  constexpr std::size_t most = std::size_t{1} << 20, fields = 32768;
  std::string names = "FIELDS x y z", sizes = "SIZE 4 4 4", types = "TYPE F F F", counts = "COUNT 1 1 1";
  for (std::size_t i = 0; i <= fields; ++i) {
    names += " a";
    types += " U";
    sizes += i < 2 ? " 4" : " 8";
    counts += fmt::format(" {}", i == 0 ? most - 3 : most);
  }
  for (const std::string data : {"binary_compressed", "binary", "ascii"}) {
    const std::string bytes = fmt::format("{}\n{}\n{}\n{}\nWIDTH {}\nHEIGHT 1\nDATA {}\n", names, sizes, types, counts, kMaxPoints, data);
    EXPECT_THAT(refusal_of(folder.write("endless.pcd", bytes + std::string(8, '\0'))), HasSubstr("more than 1048576 bytes per point"));
  }
}

// Between semicolons a comma is decimal: two numbers are no point, whatever digits they have.
TEST(PointFiles, ALineWithSemicolonsIsNotCutAtCommas) {
  const TempFolder folder;
  for (std::uint32_t i = 0; i < 20; ++i) {
    const RandomStream random(43, Purpose::test, i);
    const auto number = [&](std::uint32_t at) { return fmt::format("{},{}", random.below(90, 2 * at), 1 + random.below(9, 2 * at + 1)); };
    const std::string two = number(0) + (i % 2 == 0 ? ";" : "; ") + number(1), three = two + ";" + number(2);
    EXPECT_THAT(refusal_of(folder.write("a.xyz", three + "\n" + two + "\n")), HasSubstr("line 2 has 2 columns"));
    EXPECT_THAT(refusal_of(folder.write("a.xyz", two + ";\n")), HasSubstr("line 1 has 2 columns"));
    EXPECT_EQ(read_point_file(folder.write("a.xyz", three + "\n")).positions.size(), 1u);
  }
}

// A file that declares its length is refused wherever it is cut; others are cut by whole lines.
TEST(PointFiles, ACutFileIsRefused) {
  const TempFolder folder;
  const Points points = drawn_points(40, 10);
  std::uint32_t draw = 0;
  for (const auto& [name, bytes] : files_of(points)) {
    const bool is_counted =
        name.find("ply") != std::string::npos || name.find("pcd") != std::string::npos || name.ends_with(".pts") || name.ends_with(".las");
    if (!is_counted) continue;
    for (int i = 0; i < 20; ++i) {
      // The last digits of a text may be cut without a trace: three bytes and more are not.
      const std::size_t cut = 4 + RandomStream(3, Purpose::test).below(static_cast<std::uint32_t>(bytes.size() - 8), draw++);
      const std::string message = refusal_of(folder.write(name, bytes.substr(0, bytes.size() - cut)));
      EXPECT_THAT(message, HasSubstr(name)) << cut;
      EXPECT_EQ(message.find('\n'), std::string::npos) << message;
    }
  }
}

TEST(PointFiles, DamagedFilesAreReadOrRefusedInOneLine) {
  const TempFolder folder;
  for (const auto& [name, bytes] : files_of(drawn_points(30, 11))) {
    for (std::uint32_t number = 0; number < 60; ++number) {
      const std::string path = folder.write(name, mutated(bytes, number, number % 2 ? 0 : std::min<std::size_t>(bytes.size(), 200)));
      const std::string message = refusal_of(path);
      EXPECT_EQ(message.find('\n'), std::string::npos) << message;
    }
  }
}

}  // namespace
}  // namespace earshot
