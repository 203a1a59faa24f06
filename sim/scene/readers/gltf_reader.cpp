// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/readers/gltf_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <numeric>

#include "sim/base/errors.h"
#include "sim/scene/readers/gltf_buffers.h"
#include "sim/scene/readers/gltf_extensions.h"
#include "sim/scene/readers/gltf_instances.h"

namespace earshot {
namespace {

using Json = nlohmann::json;

/// Of all instances of a primitive.
constexpr std::size_t kMaxCorners = std::size_t{1} << 30;
constexpr std::size_t kPlain = 4, kStrip = 5, kFan = 6;

/// Strips and fans as plain triangles (glTF 2.0, section 3.7.2.1); other modes have none.
std::vector<std::uint32_t> triangle_corners(const std::vector<std::uint32_t>& indices, std::size_t mode) {
  if (mode == kPlain) return indices;
  std::vector<std::uint32_t> corners;
  if (mode != kStrip && mode != kFan) return corners;
  for (std::size_t i = 0; i + 2 < indices.size(); ++i) {
    if (mode == kFan)
      corners.insert(corners.end(), {indices[i + 1], indices[i + 2], indices[0]});
    else
      corners.insert(corners.end(), {indices[i], indices[i + 1 + i % 2], indices[i + 2 - i % 2]});
  }
  return corners;
}

class GltfReader {
 public:
  using Visit = std::function<void(const GltfPrimitive&)>;

  GltfReader(const std::filesystem::path& path, const Visit& visit)
      : where_(path.string()), asset_(path), visit_(visit), warnings_(check_gltf_extensions(asset_.json(), where_)) {}

  void append_scene(const glm::dmat4& file_to_world) {
    struct Pending {
      std::size_t node;
      glm::dmat4 to_world;
    };
    std::vector<Pending> pending;  // an explicit stack: the depth of a file is not bounded
    const std::vector<std::size_t> tops = roots();
    for (std::size_t i = tops.size(); i-- > 0;) pending.push_back({tops[i], file_to_world});  // the first one ends on top
    std::vector<bool> visited(list("nodes").size(), false);
    while (!pending.empty()) {
      const auto [index, parent_to_world] = pending.back();
      pending.pop_back();
      const Json& node = list("nodes").at(index);
      if (visited[index]) throw InputError(where_, fmt::format("node {} has two parents", index), "export the file again");
      visited[index] = true;
      const glm::dmat4 to_world = parent_to_world * gltf_node_to_parent(node);
      if (node.contains("mesh")) append_mesh(node, index, to_world);
      if (!node.contains("children")) continue;
      const auto children = node["children"].get<std::vector<std::size_t>>();
      for (std::size_t i = children.size(); i-- > 0;) pending.push_back({children[i], to_world});
    }
    if (num_triangles_ != num_promised_)
      throw InputError(where_, fmt::format("declares {} triangles, but only {} could be read", num_promised_, num_triangles_),
                       "export the file again");
  }
  [[nodiscard]] std::vector<std::string> take_warnings() { return std::move(warnings_); }

 private:
  [[nodiscard]] const Json& list(const char* key) const {
    static const Json empty_list = Json::array();
    if (!asset_.json().contains(key)) return empty_list;
    const Json& found = asset_.json()[key];
    if (!found.is_array()) throw InputError(where_, fmt::format("'{}' is not a list", key), "export the file again");
    return found;
  }

  /// Nodes of the default scene; without scenes, all root nodes.
  [[nodiscard]] std::vector<std::size_t> roots() const {
    const Json& scenes = list("scenes");
    if (!scenes.empty()) {
      const Json& scene = scenes.at(asset_.json().value("scene", std::size_t{0}));
      return scene.value("nodes", std::vector<std::size_t>{});
    }
    std::vector<bool> is_child(list("nodes").size(), false);
    for (const Json& node : list("nodes")) {
      for (const std::size_t child : node.value("children", std::vector<std::size_t>{})) {
        if (child < is_child.size()) is_child[child] = true;
      }
    }
    std::vector<std::size_t> found;
    for (std::size_t i = 0; i < is_child.size(); ++i) {
      if (!is_child[i]) found.push_back(i);
    }
    return found;
  }

  void append_mesh(const Json& node, std::size_t node_index, const glm::dmat4& to_world) {
    const Json& mesh = list("meshes").at(node["mesh"].get<std::size_t>());
    std::string object = node.value("name", std::string());
    if (object.empty()) object = mesh.value("name", std::string());
    if (object.empty()) object = fmt::format("node_{}", node_index);
    const std::vector<glm::dmat4> instances = gltf_instances(asset_, node, where_);
    for (const Json& primitive : mesh.at("primitives")) {
      const Json& attributes = primitive.at("attributes");
      if (!attributes.contains("POSITION")) {
        warnings_.push_back(fmt::format("a primitive of '{}' has no positions and is ignored", one_line(object)));
        continue;
      }
      std::vector<glm::dvec3> positions = asset_.read_positions(attributes["POSITION"].get<std::size_t>());
      apply_morph_targets(asset_, node, mesh, primitive, where_, positions);
      const std::vector<std::uint32_t> corners = read_corners(primitive, positions.size(), instances.size());
      for (const glm::dmat4& instance : instances) {
        num_triangles_ += corners.size() / 3;
        visit_({asset_, primitive, object, material_name(primitive), to_world * instance, positions, corners});
      }
    }
  }

  std::vector<std::uint32_t> read_corners(const Json& primitive, std::size_t num_positions, std::size_t num_instances) {
    const std::size_t mode = primitive.value("mode", kPlain);
    std::vector<std::uint32_t> indices(primitive.contains("indices") ? 0 : num_positions);
    if (primitive.contains("indices"))
      indices = asset_.read_indices(primitive["indices"].get<std::size_t>());
    else
      std::iota(indices.begin(), indices.end(), 0u);
    if (mode > kFan) throw InputError(where_, fmt::format("a primitive has an unknown mode {}", mode), "export the file again");
    if (mode == kPlain && indices.size() % 3 != 0)
      throw InputError(where_, fmt::format("a primitive has {} triangle corners, which is not a multiple of three", indices.size()),
                       "export the file again");
    std::vector<std::uint32_t> corners = triangle_corners(indices, mode);
    num_promised_ += num_instances * promised_triangles(primitive, mode);
    num_copied_ += std::max(corners.size(), num_positions) * num_instances;
    if (num_copied_ > kMaxCorners)
      throw InputError(where_, fmt::format("has {} instances of {} triangles", num_instances, corners.size() / 3), "simplify it");
    return corners;
  }

  /// By the count of its accessor.
  [[nodiscard]] std::uint64_t promised_triangles(const Json& primitive, std::size_t mode) const {
    const Json& accessor = primitive.contains("indices") ? primitive["indices"] : primitive.at("attributes").at("POSITION");
    const auto count = list("accessors").at(accessor.get<std::size_t>()).at("count").get<std::uint64_t>();
    if (mode == kPlain) return count / 3;
    return (mode == kStrip || mode == kFan) && count > 2 ? count - 2 : 0;
  }

  [[nodiscard]] std::string material_name(const Json& primitive) const {
    if (!primitive.contains("material")) return "default";
    const auto index = primitive["material"].get<std::size_t>();
    const std::string name = list("materials").at(index).value("name", std::string());
    return name.empty() ? fmt::format("material_{}", index) : name;
  }

  std::string where_;
  GltfAsset asset_;
  const Visit& visit_;
  std::vector<std::string> warnings_;
  std::uint64_t num_triangles_ = 0, num_promised_ = 0, num_copied_ = 0;
};

}  // namespace

std::vector<std::string> visit_gltf(const std::filesystem::path& path, const glm::dmat4& file_to_world,
                                    const std::function<void(const GltfPrimitive& primitive)>& visit) {
  try {
    GltfReader reader(path, visit);
    reader.append_scene(file_to_world);
    return reader.take_warnings();
  } catch (const Json::exception& error) {  // a key is missing or of the wrong type
    throw InputError(path.string(), "is not valid glTF: " + one_line(error.what()), "export the file again");
  } catch (const std::out_of_range&) {
    throw InputError(path.string(), "is not valid glTF: an index is out of range", "export the file again");
  }
}

std::vector<std::string> read_gltf(const std::filesystem::path& path, const glm::dmat4& file_to_world, MeshBuilder& builder,
                                   SurfaceNames* names) {
  return visit_gltf(path, file_to_world, [&](const GltfPrimitive& part) {
    builder.append(part.object, part.material, part.to_world, part.positions, part.corners, PositionDigits::floats);
    if (!names) return;
    const std::vector<std::uint32_t> numbers = names->of_primitive(part);  // all() is for after it
    builder.name_last(numbers, names->all());
  });
}

}  // namespace earshot
