// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <map>
#include <string>
#include <vector>

#include "sim/base/random.h"
#include "tests/support/files/gltf_files.h"

namespace earshot {

/// A room with a box in it, each face an instance of a category, in the forms of the data sets; knows nothing of their readers.  Size, ids,
/// colours and categories are drawn.  Positions are multiples of 1/64 m: text and floats hold them exactly.
struct AnnotatedRoom {
  struct Face {
    std::array<std::uint32_t, 4> corners;
    std::int64_t id;
  };
  struct Instance {
    std::string category;
    std::uint32_t color = 0;
  };

  std::vector<glm::dvec3> corners;
  std::vector<Face> faces;
  std::map<std::int64_t, Instance> instances;
  glm::dvec3 size{0};

  /// num_unlabelled: that many faces carry an id without an entry, every second one a negative id.
  explicit AnnotatedRoom(std::uint32_t number, std::size_t num_unlabelled = 0) : random_(2037, Purpose::test, number) {
    size = {grid(4, 7), grid(2.5, 4), grid(4, 7)};
    add_box({0, 0, 0}, size, {"floor", "ceiling", "wall", "wall", "door", "window"});
    const glm::dvec3 lower{grid(0.5, 1), grid(0.25, 0.5), grid(0.5, 1)};
    add_box(lower, lower + glm::dvec3(grid(0.5, 1), grid(0.5, 1), grid(0.5, 1)), {"sofa", "sofa", "sofa", "chest of drawers", "tv", "tv"});
    for (std::size_t i = 0; i < num_unlabelled; ++i) {
      Face& face = faces[(5 + 4 * i) % faces.size()];
      instances.erase(face.id);
      if (i % 2 == 0) face.id = -1 - static_cast<std::int64_t>(i);
    }
  }

  [[nodiscard]] std::string category_of(const Face& face) const {
    const auto found = instances.find(face.id);
    return found == instances.end() ? "unlabelled" : found->second.category;
  }
  [[nodiscard]] double area_m2(const Face& face) const {
    return glm::length(
        glm::cross(corners[face.corners[1]] - corners[face.corners[0]], corners[face.corners[3]] - corners[face.corners[0]]));
  }
  /// Of each category, unlabelled among them.
  [[nodiscard]] std::map<std::string, double> areas_m2() const {
    std::map<std::string, double> areas;
    for (const Face& face : faces) areas[category_of(face)] += area_m2(face);
    return areas;
  }
  [[nodiscard]] double unlabelled_percent() const {
    double all = 0, unlabelled = 0;
    for (const auto& [category, area] : areas_m2()) {
      all += area;
      if (category == "unlabelled") unlabelled = area;
    }
    return 100 * unlabelled / all;
  }
  [[nodiscard]] glm::dvec3 source() const { return size * glm::dvec3(0.7, 0.6, 0.6); }
  [[nodiscard]] glm::dvec3 listener() const { return size * glm::dvec3(0.6, 0.5, 0.8); }

  /// The same geometry with the names written by hand: categories as materials, instances as objects.
  [[nodiscard]] std::string obj() const {
    std::string text;
    for (const glm::dvec3& p : corners) text += fmt::format("v {} {} {}\n", p.x, p.y, p.z);
    for (const Face& face : faces) {
      const std::string category = category_of(face);
      text += fmt::format("o {}\nusemtl {}\nf", category == "unlabelled" ? category : fmt::format("{}_{}", category, face.id), category);
      for (const std::uint32_t corner : face.corners) text += fmt::format(" {}", corner + 1);
      text += '\n';
    }
    return text;
  }

  /// Binary, with quads that carry their id as `property`; type: int or short.
  [[nodiscard]] std::string ply(const std::string& property = "object_id", const std::string& type = "int") const {
    std::string text = fmt::format(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face {}\n"
        "property list uchar int vertex_indices\nproperty {} {}\nend_header\n",
        corners.size(), faces.size(), type, property);
    for (const glm::dvec3& p : corners)
      for (int axis = 0; axis < 3; ++axis) put(text, static_cast<float>(p[axis]));
    for (const Face& face : faces) {
      put(text, std::uint8_t{4});
      for (const std::uint32_t corner : face.corners) put(text, corner);
      if (type == "short")
        put(text, static_cast<std::int16_t>(face.id));
      else
        put(text, static_cast<std::int32_t>(face.id));
    }
    return text;
  }
  /// Without ids, as the mesh that is shown; y upwards.
  [[nodiscard]] std::string plain_ply() const {
    std::string text =
        fmt::format("ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n", corners.size());
    text += fmt::format("element face {}\nproperty list uchar int vertex_indices\nend_header\n", faces.size());
    for (const glm::dvec3& p : corners) text += fmt::format("{} {} {}\n", p.x, p.y, p.z);
    for (const Face& face : faces)
      text += fmt::format("4 {} {} {} {}\n", face.corners[0], face.corners[1], face.corners[2], face.corners[3]);
    return text;
  }

  [[nodiscard]] std::string replica_info(bool has_class_names = true) const {
    nlohmann::json classes = nlohmann::json::array(), objects = nlohmann::json::array();
    std::map<std::string, int> class_of;
    for (const auto& [id, instance] : instances) {
      const auto [found, is_new] = class_of.try_emplace(instance.category, static_cast<int>(7 + 3 * class_of.size()));
      if (is_new) classes.push_back({{"id", found->second}, {"name", instance.category}});
      nlohmann::json object{{"id", id}, {"class_id", found->second}, {"oriented_bbox", {{"abb", {{"center", {0, 0, 0}}}}}}};
      if (has_class_names) object["class_name"] = instance.category;
      objects.push_back(object);
    }
    return json_text(nlohmann::json{{"classes", classes}, {"objects", objects}});
  }

  [[nodiscard]] std::string house() const {
    std::map<std::string, int> category_index;
    std::string categories, objects;
    for (const auto& [id, instance] : instances) {
      const auto [found, is_new] = category_index.try_emplace(instance.category, static_cast<int>(category_index.size()));
      std::string name = instance.category;
      for (char& letter : name)
        if (letter == ' ') letter = '#';
      if (is_new)
        categories += fmt::format("C {} {} raw#{} {} {} 0 0 0 0 0\n", found->second, 30 + found->second, name, found->second, name);
      objects += fmt::format("O {} 0 {} 0.5 0.25 0 1 0 0 0 1 0 1 2 3 0 0 0 0 0 0 0 0\n", id, found->second);
    }
    return fmt::format(
               "ASCII 1.1\nH  room label 0 0 0 0 0 {} {} 1 0 1 0 0 0 0 0 0 0 0 9 9 9 0 0 0 0 0\nL 0 1 level 0 0 0 0 0 0 9 9 9 0 0 0\n"
               "R 0 0 0 0 b 0 0 0 0 0 0 9 9 9 0 0 0 0 0\n",
               instances.size(), category_index.size()) +
           categories + objects + "E 0 1 2 0.5 0 0 0 0 0 0 1 1 1 0 0 0 0 0\n";
  }

  [[nodiscard]] std::string semantic_text() const {
    std::string text = "HM3D Semantic Annotations\n";
    int region = -1;
    for (const auto& [id, instance] : instances)
      text += fmt::format("{},{:06X},\"{}\",{}\n", id < 0 ? 900 - id : id, instance.color, instance.category, region++);
    return text;
  }
  [[nodiscard]] std::uint32_t color_of(const Face& face) const {
    const auto found = instances.find(face.id);
    return found == instances.end() ? 0x010203u : found->second.color;
  }
  /// As HM3D: colours of instances at the vertices of each face.  change: of the colours of single vertices, up to one per triangle.
  [[nodiscard]] GltfWriter colored_gltf() const {
    GltfWriter file = bare_gltf();
    std::vector<std::uint8_t> rgba;
    for (const Face& face : faces)
      for (int corner = 0; corner < 4; ++corner)
        for (const std::uint32_t byte : {color_of(face) >> 16, color_of(face) >> 8 & 255u, color_of(face) & 255u, 255u})
          rgba.push_back(static_cast<std::uint8_t>(byte));
    const std::size_t accessor = file.add_accessor(file.add_view(rgba), 4 * faces.size(), 5121, "VEC4");
    file.json["accessors"][accessor]["normalized"] = true;
    file.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = accessor;
    return file;
  }
  /// Four vertices and two triangles a face, without colours.
  [[nodiscard]] GltfWriter bare_gltf() const {
    GltfWriter file;
    std::vector<float> positions;
    std::vector<std::uint32_t> indices;
    for (std::uint32_t f = 0; f < faces.size(); ++f) {
      for (const std::uint32_t corner : faces[f].corners)
        for (int axis = 0; axis < 3; ++axis) positions.push_back(static_cast<float>(corners[corner][axis]));
      for (const std::uint32_t corner : {0u, 1u, 2u, 0u, 2u, 3u}) indices.push_back(4 * f + corner);
    }
    const std::size_t position = file.add_positions(positions);
    const std::size_t index = file.add_accessor(file.add_view(indices), indices.size(), 5125, "SCALAR");
    file.json["meshes"] = {{{"name", "chunk"}, {"primitives", {{{"attributes", {{"POSITION", position}}}, {"indices", index}}}}}};
    file.json["nodes"] = {{{"name", "chunk"}, {"mesh", 0}}};
    return file;
  }

 private:
  double draw() { return static_cast<double>(random_.uniform(next_++)); }
  double grid(double lower, double upper) { return std::round(64 * (lower + (upper - lower) * draw())) / 64; }

  /// Floor, ceiling, and the sides at low and high x, low and high z.
  void add_box(glm::dvec3 lower, glm::dvec3 upper, const std::array<std::string, 6>& categories) {
    const auto first = static_cast<std::uint32_t>(corners.size());
    for (unsigned corner = 0; corner < 8; ++corner)
      corners.emplace_back(corner & 1u ? upper.x : lower.x, corner & 2u ? upper.y : lower.y, corner & 4u ? upper.z : lower.z);
    constexpr std::array<std::array<std::uint32_t, 4>, 6> sides{
        {{0, 4, 5, 1}, {2, 3, 7, 6}, {0, 2, 6, 4}, {1, 5, 7, 3}, {0, 1, 3, 2}, {4, 6, 7, 5}}};
    for (std::size_t side = 0; side < sides.size(); ++side) {
      std::int64_t id = 0;
      do id = static_cast<std::int64_t>(3000 * draw());
      while (instances.contains(id));
      instances[id] = {categories[side], 0};
      std::uint32_t color = 0;
      do color = static_cast<std::uint32_t>(0xFFFFFF * draw());
      while (color == 0x010203u || is_taken(color));
      instances[id].color = color;
      Face face{sides[side], id};
      for (std::uint32_t& corner : face.corners) corner += first;
      faces.push_back(face);
    }
  }
  [[nodiscard]] bool is_taken(std::uint32_t color) const {
    for (const auto& [id, instance] : instances)
      if (instance.color == color) return true;
    return false;
  }
  template <class T>
  static void put(std::string& text, T value) {
    char bytes[sizeof(T)];
    std::memcpy(bytes, &value, sizeof(T));
    text.append(bytes, sizeof(T));
  }

  RandomStream random_;
  std::uint32_t next_ = 0;
};

}  // namespace earshot
