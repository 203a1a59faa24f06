#include "sim/scene/readers/gltf_reader.h"

#include <fmt/format.h>

#include <array>
#include <glm/gtc/quaternion.hpp>
#include <glm/gtc/type_ptr.hpp>
#include <nlohmann/json.hpp>
#include <numeric>

#include "sim/base/errors.h"
#include "sim/scene/readers/gltf_buffers.h"

namespace earshot {
namespace {

using Json = nlohmann::json;

template <std::size_t N>
std::array<double, N> read_numbers(const Json& json, const char* key, std::array<double, N> fallback) {
  return json.contains(key) ? json[key].get<std::array<double, N>>() : fallback;
}

glm::dmat4 node_to_parent(const Json& node) {
  if (node.contains("matrix")) return glm::make_mat4(read_numbers<16>(node, "matrix", {}).data());
  const auto t = read_numbers<3>(node, "translation", {0, 0, 0});
  const auto q = read_numbers<4>(node, "rotation", {0, 0, 0, 1});  // x, y, z, w
  const auto s = read_numbers<3>(node, "scale", {1, 1, 1});
  glm::dmat4 matrix = glm::mat4_cast(glm::dquat(q[3], q[0], q[1], q[2]));
  for (int axis = 0; axis < 3; ++axis) matrix[axis] *= s[static_cast<std::size_t>(axis)];
  matrix[3] = glm::dvec4(t[0], t[1], t[2], 1);
  return matrix;
}

/// Strips and fans as plain triangles (glTF 2.0, section 3.7.2.1); other modes have none.
std::vector<std::uint32_t> triangle_corners(const std::vector<std::uint32_t>& indices, std::size_t mode) {
  constexpr std::size_t plain = 4, strip = 5, fan = 6;
  if (mode == plain) return {indices.begin(), indices.end() - static_cast<std::ptrdiff_t>(indices.size() % 3)};
  std::vector<std::uint32_t> corners;
  if (mode != strip && mode != fan) return corners;
  for (std::size_t i = 0; i + 2 < indices.size(); ++i) {
    if (mode == fan)
      corners.insert(corners.end(), {indices[i + 1], indices[i + 2], indices[0]});
    else
      corners.insert(corners.end(), {indices[i], indices[i + 1 + i % 2], indices[i + 2 - i % 2]});
  }
  return corners;
}

class GltfReader {
 public:
  using Visit = std::function<void(const GltfPrimitive&)>;

  GltfReader(const std::filesystem::path& path, const Visit& visit) : where_(path.string()), asset_(path), visit_(visit) {
    for (const Json& extension : list("extensionsRequired")) {
      const auto name = extension.get<std::string>();
      if (name == "KHR_draco_mesh_compression" || name == "EXT_meshopt_compression" || name == "EXT_mesh_gpu_instancing") {
        throw InputError(where_, "needs the extension " + name, "export the file without compression and instancing");
      }
    }
  }

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
      if (visited[index]) throw InputError(where_, fmt::format("node {} hangs on two parents", index), "export the file again");
      visited[index] = true;
      const glm::dmat4 to_world = parent_to_world * node_to_parent(node);
      if (node.contains("mesh")) append_mesh(node, index, to_world);
      if (!node.contains("children")) continue;
      const auto children = node["children"].get<std::vector<std::size_t>>();
      for (std::size_t i = children.size(); i-- > 0;) pending.push_back({children[i], to_world});
    }
  }

 private:
  [[nodiscard]] const Json& list(const char* key) const {
    static const Json none = Json::array();
    if (!asset_.json().contains(key)) return none;
    const Json& found = asset_.json()[key];
    if (!found.is_array()) throw InputError(where_, fmt::format("'{}' is not a list", key), "export the file again");
    return found;
  }

  /// Nodes of the default scene; without scenes, all that are no node's child.
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
    for (const Json& primitive : mesh.at("primitives")) {
      const Json& attributes = primitive.at("attributes");
      if (!attributes.contains("POSITION")) continue;
      std::vector<glm::vec3> positions = asset_.read_positions(attributes["POSITION"].get<std::size_t>());
      std::vector<std::uint32_t> indices(primitive.contains("indices") ? 0 : positions.size());
      if (primitive.contains("indices"))
        indices = asset_.read_indices(primitive["indices"].get<std::size_t>());
      else
        std::iota(indices.begin(), indices.end(), 0u);
      std::vector<std::uint32_t> corners = triangle_corners(indices, primitive.value("mode", std::size_t{4}));
      visit_({asset_, primitive, object, material_name(primitive), to_world, std::move(positions), std::move(corners)});
    }
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
};

}  // namespace

void visit_gltf(const std::filesystem::path& path, const glm::dmat4& file_to_world,
                const std::function<void(const GltfPrimitive& primitive)>& visit) {
  try {
    GltfReader(path, visit).append_scene(file_to_world);
  } catch (const Json::exception& error) {  // a key is missing or of the wrong type
    throw InputError(path.string(), "is not valid glTF: " + one_line(error.what()), "export the file again");
  } catch (const std::out_of_range&) {
    throw InputError(path.string(), "is not valid glTF: an index points nowhere", "export the file again");
  }
}

void read_gltf(const std::filesystem::path& path, const glm::dmat4& file_to_world, MeshBuilder& builder) {
  visit_gltf(path, file_to_world,
             [&](const GltfPrimitive& part) { builder.append(part.object, part.material, part.to_world, part.positions, part.corners); });
}

}  // namespace earshot
