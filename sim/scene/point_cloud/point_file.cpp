// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/point_cloud/point_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <optional>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/text_match.h"
#include "sim/scene/point_cloud/las_reader.h"
#include "sim/scene/point_cloud/pcd_reader.h"
#include "sim/scene/point_cloud/xyz_reader.h"
#include "sim/scene/readers/mesh_import.h"
#include "sim/scene/readers/ply_header.h"
#include "sim/scene/readers/ply_reader.h"

namespace earshot {
namespace {

std::string cloud_extension(const std::filesystem::path& path) { return fold_case(path.extension().string()); }

/// Whether the header of a PLY file declares vertices and no faces.
bool declares_points_alone(std::string_view header_text) {
  try {
    const PlyHeader header = parse_ply_header(header_text, "", PlyPart::header);
    const auto has = [&](const auto& is) { return std::ranges::any_of(header.elements, is); };
    return has([](const PlyElement& element) { return element.name == "vertex" && element.count > 0; }) &&
           !has([](const PlyElement& element) { return element.count > 0 && std::ranges::any_of(element.properties, is_corner_list); });
  } catch (const InputError&) {
    return false;  // whoever reads it says so
  }
}

PointCloud read_ply_points(std::string_view bytes, const std::filesystem::path& path) {
  MeshFile file = parse_ply(bytes, path.string(), path.stem().string(), false);
  PointCloud cloud{.positions = {}, .num_invalid = 0, .warnings = std::move(file.warnings)};
  cloud.warnings.insert(cloud.warnings.end(), file.doubts.begin(), file.doubts.end());
  for (MeshPart& part : file.parts) cloud.positions.insert(cloud.positions.end(), part.positions.begin(), part.positions.end());
  return cloud;
}

}  // namespace

void require_point_count(std::uint64_t count, const std::string& where) {
  if (count > kMaxPoints)
    throw InputError(where, fmt::format("has {} points, and at most {} are read", count, kMaxPoints), "thin it out, or cut it into parts");
}

bool is_las_file(const std::filesystem::path& path) {
  const std::string extension = cloud_extension(path);
  return extension == ".las" || extension == ".laz";
}

bool is_point_cloud(const std::filesystem::path& path) {
  if (has_cloud_extension(path)) return true;
  if (cloud_extension(path) != ".ply") return false;
  constexpr std::size_t kLargestHeader = 65536;
  std::string header(kLargestHeader, '\0');
  std::ifstream file(path, std::ios::binary);
  file.read(header.data(), static_cast<std::streamsize>(header.size()));
  header.resize(static_cast<std::size_t>(std::max<std::streamsize>(file.gcount(), 0)));
  std::string_view text = header;
  if (text.starts_with("\xEF\xBB\xBF")) text.remove_prefix(3);
  return text.starts_with("ply") && declares_points_alone(text);
}

PointCloud read_point_file(const std::filesystem::path& path) {
  const std::string where = path.string(), extension = cloud_extension(path);
  std::error_code error;
  if (!std::filesystem::exists(path, error)) throw InputError(where, "does not exist", "check the path of the point cloud");
  if (!std::filesystem::is_regular_file(path, error)) throw InputError(where, "is not a file", "give a ply, pcd, xyz or las file");
  if (extension == ".laz") throw InputError(where, "is a compressed LAS file (LAZ), which is not read", "convert it to LAS");
  const std::string whole = read_file(path);
  std::string_view bytes = whole;
  if (bytes.starts_with("\xEF\xBB\xBF")) bytes.remove_prefix(3);
  PointCloud cloud = extension == ".ply"   ? read_ply_points(bytes, path)
                     : extension == ".pcd" ? parse_pcd(bytes, where)
                     : extension == ".las" ? parse_las(bytes, where)
                                           : parse_xyz(bytes, where);
  require_point_count(cloud.positions.size(), where);
  const auto is_finite = [](glm::dvec3 p) { return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z); };
  cloud.num_invalid += std::erase_if(cloud.positions, [&](glm::dvec3 p) { return !is_finite(p); });
  if (cloud.positions.empty()) throw InputError(where, "has no points with finite coordinates", "export the points again");
  return cloud;
}

}  // namespace earshot
