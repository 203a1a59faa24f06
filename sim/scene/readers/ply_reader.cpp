// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/readers/ply_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <optional>

#include "sim/base/errors.h"
#include "sim/scene/readers/mesh_builder.h"
#include "sim/scene/readers/ply_body.h"
#include "sim/scene/readers/ply_header.h"

namespace earshot {
namespace {

/// Number of an axis (0 to 2) or a colour (3 to 5) that a property of a vertex is; nullopt for others.
std::optional<int> column_of(const PlyProperty& property, bool with_looks) {
  constexpr std::array<std::array<std::string_view, 4>, 6> names{
      {{"x"}, {"y"}, {"z"}, {"red", "r", "diffuse_red"}, {"green", "g", "diffuse_green"}, {"blue", "b", "diffuse_blue"}}};
  if (property.count_type || property.name.empty()) return std::nullopt;
  for (std::size_t column = 0; column < (with_looks ? names.size() : 3); ++column)
    if (std::find(names[column].begin(), names[column].end(), property.name) != names[column].end()) return static_cast<int>(column);
  return std::nullopt;
}

/// The number of the instance that a face belongs to: of Replica and Habitat, or of Matterport3D's own meshes.  A fraction is none.
bool is_face_id(const PlyProperty& property) {
  const bool is_whole = property.type != PlyType::float32 && property.type != PlyType::float64;
  return !property.count_type && is_whole && (property.name == "object_id" || property.name == "face_segment");
}

double largest_color(PlyType type) { return type == PlyType::uint8 ? 255 : type == PlyType::uint16 ? 65535 : 1; }

class PlyParser {
 public:
  PlyParser(std::string_view bytes, const std::string& where, const std::string& object, bool with_looks)
      : where_(where), with_looks_(with_looks), header_(parse_ply_header(bytes, where)), body_(bytes, header_, where) {
    part_.object = object;
    part_.material = "material_0";
  }

  MeshFile parse() {
    bool has_vertices = false;
    for (const PlyElement& element : header_.elements) {
      if (element.name == "vertex") {
        if (has_vertices) fail("has two elements 'vertex'");
        has_vertices = true;
        read_vertices(element);
      } else if (element.name == "face" || element.name == "tristrips") {
        read_faces(element);
      } else {
        pass_over(element);
      }
    }
    const bool is_text = header_.body == PlyHeader::Body::ascii;
    if (const std::string line = body_.end(); !line.empty()) (is_text ? doubts_ : warnings_).push_back(line);
    return assemble();
  }

 private:
  [[noreturn]] void fail(const std::string& problem) const {
    throw InputError(where_, problem, "check the file in a mesh viewer or export it again");
  }

  void skip(const PlyProperty& property) {
    std::int64_t count = 1;
    if (property.count_type) count = list_length(property);
    for (std::int64_t i = 0; i < count; ++i) body_.skip(property.type);
  }

  std::int64_t list_length(const PlyProperty& property) {
    const std::int64_t count = body_.whole(*property.count_type);
    if (count < 0) fail(fmt::format("a list '{}' has the length {}", one_line(property.name), count));
    return count;
  }

  void read_vertices(const PlyElement& element) {
    std::vector<std::optional<int>> columns;
    std::array<bool, 6> has{};
    for (const PlyProperty& property : element.properties) {
      columns.push_back(column_of(property, with_looks_));
      if (!columns.back()) continue;
      has[static_cast<std::size_t>(*columns.back())] = true;
      const bool is_float = property.type == PlyType::float32 && header_.body != PlyHeader::Body::ascii;
      part_.has_floats = part_.has_floats || (*columns.back() < 3 && is_float);
    }
    if (element.count > 0 && !(has[0] && has[1] && has[2])) fail("the vertices have no x, y and z");
    const bool has_color = has[3] && has[4] && has[5];
    std::array<double, 6> values{};
    for (std::uint64_t i = 0; i < element.count; ++i) {
      for (std::size_t p = 0; p < columns.size(); ++p) {
        const PlyProperty& property = element.properties[p];
        if (columns[p])
          values[static_cast<std::size_t>(*columns[p])] =
              body_.number(property.type) / (*columns[p] < 3 ? 1 : largest_color(property.type));
        else
          skip(property);
      }
      body_.end_element();
      part_.positions.emplace_back(values[0], values[1], values[2]);
      if (has_color) part_.colors.emplace_back(values[3], values[4], values[5]);
    }
  }

  /// Faces and strips, kept until the vertices are known.
  void read_faces(const PlyElement& element) {
    const auto lists = std::count_if(element.properties.begin(), element.properties.end(), is_corner_list);
    if (element.count > 0 && lists != 1) fail(fmt::format("the element '{}' has {} lists vertex_indices", element.name, lists));
    const bool is_strip = element.name == "tristrips";
    const auto id = std::find_if(element.properties.begin(), element.properties.end(), is_face_id);
    has_ids_ = has_ids_ || (id != element.properties.end() && element.count > 0);
    for (std::uint64_t i = 0; i < element.count; ++i) {
      std::int64_t face_id = -1;
      for (const PlyProperty& property : element.properties) {
        if (id != element.properties.end() && &property == &*id) {
          face_id = body_.whole(property.type);
          continue;
        }
        if (!is_corner_list(property)) {
          skip(property);
          continue;
        }
        const std::int64_t count = list_length(property);
        const std::size_t first = corners_.size();
        for (std::int64_t c = 0; c < count; ++c) corners_.push_back(corner(property, is_strip));
        faces_.push_back({first, corners_.size() - first, is_strip, -1});
      }
      faces_.back().id = face_id;  // there is one list
      body_.end_element();
    }
  }

  /// kRestart where a strip ends within its list.
  std::uint32_t corner(const PlyProperty& property, bool is_strip) {
    const std::int64_t index = body_.whole(property.type);
    if (is_strip && index == -1) return kRestart;
    if (index < 0 || index >= kRestart)
      fail(fmt::format("face {} uses vertex {}, but there are {} vertices", faces_.size(), index, part_.positions.size()));
    return static_cast<std::uint32_t>(index);
  }

  void pass_over(const PlyElement& element) {
    const bool has_surface = std::any_of(element.properties.begin(), element.properties.end(), is_corner_list);
    if (has_surface && element.count > 0)
      warnings_.push_back(fmt::format("the PLY elements '{}' ({}) are ignored", one_line(element.name), element.count));
    // An element without properties has no bytes, whatever its count.
    for (std::uint64_t i = 0; i < element.count && !element.properties.empty(); ++i) {
      for (const PlyProperty& property : element.properties) skip(property);
      body_.end_element();
    }
  }

  MeshFile assemble() {
    FaceCutter cutter(where_);
    std::uint64_t num_strips = 0;
    for (const Face& face : faces_) {
      const auto corners = std::span<const std::uint32_t>(corners_).subspan(face.first, face.count);
      if (face.is_strip) {
        ++num_strips;
        cut_strip(corners);
      } else {
        cutter.add(corners, part_);
      }
      if (has_ids_) part_.triangle_ids.resize(part_.corners.size() / 3, face.id);
    }
    if (const std::string warning = cutter.warning(); !warning.empty()) warnings_.push_back(warning);
    MeshFile file{
        .parts = {}, .num_faces = cutter.num_faces() + num_strips, .warnings = std::move(warnings_), .doubts = std::move(doubts_)};
    file.parts.push_back(std::move(part_));
    return file;
  }

  /// Every second triangle of a strip is wound the other way; each -1 begins a new strip.
  void cut_strip(std::span<const std::uint32_t> corners) {
    std::size_t begin = 0;
    for (std::size_t i = 0; i < corners.size(); ++i) {
      if (corners[i] == kRestart) {
        begin = i + 1;
        continue;
      }
      if (corners[i] >= part_.positions.size())
        fail(fmt::format("a strip uses vertex {}, but there are {} vertices", corners[i], part_.positions.size()));
      if (i < begin + 2) continue;
      const bool is_odd = (i - begin) % 2 != 0;
      part_.corners.insert(part_.corners.end(), {corners[i - (is_odd ? 1 : 2)], corners[i - (is_odd ? 2 : 1)], corners[i]});
    }
  }

  static constexpr std::uint32_t kRestart = 0xFFFFFFFFu;
  struct Face {
    std::size_t first, count;
    bool is_strip;
    std::int64_t id;
  };

  const std::string& where_;
  bool with_looks_;
  PlyHeader header_;
  PlyBody body_;
  MeshPart part_;
  std::vector<std::uint32_t> corners_;
  std::vector<Face> faces_;
  bool has_ids_ = false;
  std::vector<std::string> warnings_, doubts_;
};

}  // namespace

MeshFile parse_ply(std::string_view bytes, const std::string& where, const std::string& object, bool with_looks) {
  return PlyParser(bytes, where, object, with_looks).parse();
}

}  // namespace earshot
