// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/readers/gltf_instances.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>
#include <glm/gtc/type_ptr.hpp>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr std::uint64_t kMaxInstances = 1'000'000;  // of one node

using Json = nlohmann::json;

glm::dmat4 transform_of(glm::dvec3 translation, glm::dquat rotation, glm::dvec3 scale) {
  glm::dmat4 matrix = glm::mat4_cast(rotation);
  for (int axis = 0; axis < 3; ++axis) matrix[axis] *= scale[axis];
  matrix[3] = glm::dvec4(translation, 1);
  return matrix;
}

template <std::size_t N>
std::array<double, N> read_numbers(const Json& json, const char* key, std::array<double, N> fallback) {
  return json.contains(key) ? json[key].get<std::array<double, N>>() : fallback;
}

}  // namespace

glm::dmat4 gltf_node_to_parent(const Json& node) {
  if (node.contains("matrix")) return glm::make_mat4(read_numbers<16>(node, "matrix", {}).data());
  const auto t = read_numbers<3>(node, "translation", {0, 0, 0});
  const auto q = read_numbers<4>(node, "rotation", {0, 0, 0, 1});  // x, y, z, w
  const auto s = read_numbers<3>(node, "scale", {1, 1, 1});
  return transform_of({t[0], t[1], t[2]}, glm::dquat(q[3], q[0], q[1], q[2]), {s[0], s[1], s[2]});
}

std::vector<glm::dmat4> gltf_instances(const GltfAsset& asset, const Json& node, const std::string& where) {
  constexpr const char* name = "EXT_mesh_gpu_instancing";
  if (!node.contains("extensions") || !node["extensions"].contains(name)) return {glm::dmat4(1)};
  const Json& attributes = node["extensions"][name].at("attributes");
  const auto read = [&](const char* key, std::size_t components) {
    return attributes.contains(key) ? asset.read_accessor(attributes[key].get<std::size_t>(), components) : std::vector<double>();
  };
  std::uint64_t most = 0;
  for (const Json& index : attributes)
    most = std::max(most, asset.json().at("accessors").at(index.get<std::size_t>()).at("count").get<std::uint64_t>());
  if (most == 0) throw InputError(where, fmt::format("{} of a node has no instances", name), "export the file again");
  if (most > kMaxInstances) throw InputError(where, fmt::format("has {} instances of one mesh", most), "simplify it");
  const std::vector<double> t = read("TRANSLATION", 3), q = read("ROTATION", 4), s = read("SCALE", 3);
  const auto count = static_cast<std::size_t>(most);
  const auto differs = [&](std::size_t size) { return size != 0 && size != count; };
  if (differs(t.size() / 3) || differs(q.size() / 4) || differs(s.size() / 3))
    throw InputError(where, fmt::format("the attributes of {} have different counts", name), "export the file again");
  std::vector<glm::dmat4> instances;
  instances.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    const glm::dvec3 translation = t.empty() ? glm::dvec3(0) : glm::dvec3(t[3 * i], t[3 * i + 1], t[3 * i + 2]);
    const glm::dquat rotation = q.empty() ? glm::dquat(1, 0, 0, 0) : glm::dquat(q[4 * i + 3], q[4 * i], q[4 * i + 1], q[4 * i + 2]);
    const glm::dvec3 scale = s.empty() ? glm::dvec3(1) : glm::dvec3(s[3 * i], s[3 * i + 1], s[3 * i + 2]);
    // Bytes and shorts are of unit length up to their rounding.
    instances.push_back(transform_of(translation, glm::dot(rotation, rotation) > 0 ? glm::normalize(rotation) : rotation, scale));
  }
  return instances;
}

void apply_morph_targets(const GltfAsset& asset, const Json& node, const Json& mesh, const Json& primitive, const std::string& where,
                         std::vector<glm::dvec3>& positions) {
  const Json& holder = node.contains("weights") ? node : mesh;
  if (!primitive.contains("targets") || !holder.contains("weights")) return;
  const auto weights = holder["weights"].get<std::vector<double>>();
  const Json& targets = primitive["targets"];
  if (targets.size() != weights.size())
    throw InputError(where, fmt::format("has {} weights for {} morph targets", weights.size(), targets.size()), "export the file again");
  for (std::size_t i = 0; i < weights.size(); ++i) {
    if (weights[i] == 0 || !targets[i].contains("POSITION")) continue;
    const std::vector<double> offsets = asset.read_accessor(targets[i]["POSITION"].get<std::size_t>(), 3);
    if (offsets.size() != 3 * positions.size())
      throw InputError(where, fmt::format("morph target {} has {} offsets for {} vertices", i, offsets.size() / 3, positions.size()),
                       "export the file again");
    for (std::size_t v = 0; v < positions.size(); ++v)
      positions[v] += weights[i] * glm::dvec3(offsets[3 * v], offsets[3 * v + 1], offsets[3 * v + 2]);
  }
}

}  // namespace earshot
