// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "sim/base/random.h"
#include "sim/scene/mesh/triangle_mesh.h"

namespace earshot {

using Points = std::vector<glm::dvec3>;

/// Points spread evenly over the surface of a mesh, each moved by normal noise along every axis.  Same seed, same points.
inline Points sample_surface(const TriangleMesh& mesh, std::size_t count, double noise_m, std::uint32_t seed) {
  std::vector<double> area_below;
  double area = 0;
  for (const glm::uvec3 t : mesh.triangles) {
    const glm::vec3 a = mesh.vertices[t.x], b = mesh.vertices[t.y], c = mesh.vertices[t.z];
    area += 0.5 * static_cast<double>(glm::length(glm::cross(b - a, c - a)));
    area_below.push_back(area);
  }
  Points points;
  points.reserve(count);
  for (std::uint32_t i = 0; i < count; ++i) {
    const RandomStream random(seed, Purpose::test, i);
    const std::array<std::uint32_t, 4> bits = random.bits4(0);
    const auto draw = [&](std::size_t word) { return static_cast<double>(bits[word]) * 0x1p-32; };
    const auto found = std::lower_bound(area_below.begin(), area_below.end(), draw(0) * area);
    const glm::uvec3 t = mesh.triangles[std::min(static_cast<std::size_t>(found - area_below.begin()), mesh.triangles.size() - 1)];
    const double root = std::sqrt(draw(1)), along = draw(2);
    const glm::dvec3 a(mesh.vertices[t.x]), b(mesh.vertices[t.y]), c(mesh.vertices[t.z]);
    const auto [x, y] = random.normal2(1);
    const float z = random.normal2(2)[0];
    points.push_back((1 - root) * a + root * (1 - along) * b + root * along * c + noise_m * glm::dvec3(x, y, z));
  }
  return points;
}

template <class T>
void put_bytes(std::string& bytes, T value, bool is_big_endian = false) {
  std::array<char, sizeof(T)> raw;
  std::memcpy(raw.data(), &value, raw.size());
  if (is_big_endian) std::reverse(raw.begin(), raw.end());
  bytes.append(raw.data(), raw.size());
}

/// format: ascii, binary_little_endian or binary_big_endian; type: float or double.  A colour stands between y and z.
inline std::string ply_points(const Points& points, const std::string& format = "binary_little_endian", const std::string& type = "float") {
  std::string bytes = fmt::format(
      "ply\nformat {0} 1.0\ncomment drawn\nelement vertex {1}\nproperty {2} x\nproperty {2} y\nproperty uchar red\nproperty {2} "
      "z\nend_header\n",
      format, points.size(), type);
  for (const glm::dvec3 p : points) {
    if (format == "ascii") {
      bytes += fmt::format("{} {} 7 {}\n", p.x, p.y, p.z);
      continue;
    }
    for (int axis = 0; axis < 3; ++axis) {
      if (axis == 2) bytes += '\7';
      if (type == "float")
        put_bytes(bytes, static_cast<float>(p[axis]), format == "binary_big_endian");
      else
        put_bytes(bytes, p[axis], format == "binary_big_endian");
    }
  }
  return bytes;
}

/// Packs bytes as LibLZF does: literal runs, and references of three bytes and more to where the same three bytes stood last.
inline std::string packed_lzf(std::string_view bytes) {
  std::string packed, literals;
  const auto flush = [&] {
    for (std::size_t at = 0; at < literals.size(); at += 32) {
      const std::string run = literals.substr(at, 32);
      packed += static_cast<char>(run.size() - 1);
      packed += run;
    }
    literals.clear();
  };
  std::map<std::string_view, std::size_t> last;
  for (std::size_t at = 0; at < bytes.size();) {
    const std::string_view key = bytes.substr(at, 3);
    const auto found = last.find(key);
    std::size_t length = 0, distance = 0;
    if (key.size() == 3 && found != last.end() && (distance = at - found->second) <= 8192)
      while (length < 264 && at + length < bytes.size() && bytes[at + length] == bytes[at + length - distance]) ++length;
    if (key.size() == 3) last[key] = at;
    if (length < 3) {
      literals += bytes[at++];
      continue;
    }
    flush();
    const std::size_t code = length - 2, offset = distance - 1;
    packed += static_cast<char>(std::min<std::size_t>(code, 7) << 5 | offset >> 8);
    if (code >= 7) packed += static_cast<char>(code - 7);
    packed += static_cast<char>(offset & 255);
    at += length;
  }
  flush();
  return packed;
}

/// data: ascii, binary or binary_compressed; size: 4 or 8 bytes a coordinate.  The fields are label (two numbers), z, x, intensity, y.
inline std::string pcd_points(const Points& points, const std::string& data, std::size_t size = 4) {
  std::string bytes = fmt::format(
      "# .PCD v0.7\nVERSION 0.7\nFIELDS label z x intensity y\nSIZE 2 {0} {0} 4 {0}\nTYPE U F F F F\nCOUNT 2 1 1 1 1\nWIDTH {1}\n"
      "HEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {1}\nDATA {2}\n",
      size, points.size(), data);
  const auto put = [&](std::string& to, double value) {
    if (size == 4)
      put_bytes(to, static_cast<float>(value));
    else
      put_bytes(to, value);
  };
  std::array<std::string, 5> columns;
  for (const glm::dvec3 p : points) {
    std::array<std::string, 5> fields;
    put_bytes(fields[0], std::uint16_t{3});
    put_bytes(fields[0], std::uint16_t{9});
    put(fields[1], p.z);
    put(fields[2], p.x);
    put_bytes(fields[3], 0.5f);
    put(fields[4], p.y);
    if (data == "ascii") bytes += fmt::format("3 9 {} {} 0.5 {}\n", p.z, p.x, p.y);
    for (std::size_t i = 0; i < fields.size(); ++i) {
      if (data == "binary") bytes += fields[i];
      columns[i] += fields[i];
    }
  }
  if (data == "binary_compressed") {
    const std::string whole = columns[0] + columns[1] + columns[2] + columns[3] + columns[4], packed = packed_lzf(whole);
    put_bytes(bytes, static_cast<std::uint32_t>(packed.size()));
    put_bytes(bytes, static_cast<std::uint32_t>(whole.size()));
    bytes += packed;
  }
  return bytes;
}

/// Coordinates are multiples of 1/1024 m.  minor: 2 to 4; format: 0 to 10.
inline std::string las_points(const Points& points, int minor, int format) {
  constexpr std::array<std::size_t, 11> sizes{20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};
  const std::size_t header_size = minor == 4   ? 375
                                  : minor == 3 ? 235
                                               : 227,
                    record = sizes[static_cast<std::size_t>(format)] + 2;  // extra bytes
  std::string bytes(header_size + 10, '\0');
  const auto set = [&](std::size_t at, auto value) { std::memcpy(bytes.data() + at, &value, sizeof value); };
  std::memcpy(bytes.data(), "LASF", 4);
  set(24, std::uint8_t{1});
  set(25, static_cast<std::uint8_t>(minor));
  set(94, static_cast<std::uint16_t>(header_size));
  set(96, static_cast<std::uint32_t>(bytes.size()));
  set(104, static_cast<std::uint8_t>(format));
  set(105, static_cast<std::uint16_t>(record));
  if (format < 6) set(107, static_cast<std::uint32_t>(points.size()));
  for (std::size_t axis = 0; axis < 3; ++axis) {
    set(131 + 8 * axis, 1.0 / 1024);
    set(155 + 8 * axis, 2.0);
  }
  if (minor == 4) set(247, static_cast<std::uint64_t>(points.size()));
  for (const glm::dvec3 p : points) {
    std::string point(record, '\0');
    for (int axis = 0; axis < 3; ++axis) {
      const auto raw = static_cast<std::int32_t>(std::lround((p[axis] - 2) * 1024));
      std::memcpy(point.data() + 4 * axis, &raw, 4);
    }
    bytes += point;
  }
  return bytes;
}

/// separator: between columns.
inline std::string xyz_points(const Points& points, const std::string& separator = " ", const std::string& head = "") {
  std::string text = head;
  for (const glm::dvec3 p : points) text += fmt::format("{}{}{}{}{}{}17\n", p.x, separator, p.y, separator, p.z, separator);
  return text;
}

}  // namespace earshot
