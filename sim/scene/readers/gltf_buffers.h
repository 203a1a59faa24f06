// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <glm/vec3.hpp>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace earshot {

/// The JSON of a glTF asset and the bytes behind its accessors.
class GltfAsset {
 public:
  /// Reads .gltf or .glb with all buffers.  Throws InputError; nlohmann::json exceptions may pass too; the reader turns them into
  /// InputError.
  explicit GltfAsset(const std::filesystem::path& path);

  [[nodiscard]] const nlohmann::json& json() const { return json_; }
  /// VEC3 accessor; integers are scaled if the accessor is normalized (KHR_mesh_quantization).
  [[nodiscard]] std::vector<glm::dvec3> read_positions(std::size_t accessor) const;
  /// SCALAR accessor of unsigned integers.
  [[nodiscard]] std::vector<std::uint32_t> read_indices(std::size_t accessor) const;
  /// Accessor of any type with `components` numbers per element (1 to 4), flat; integers are scaled as in read_positions.
  [[nodiscard]] std::vector<double> read_accessor(std::size_t accessor, std::size_t components) const;
  /// The encoded bytes of an image, which lie in a buffer view, in the JSON, or in a file of their own.
  [[nodiscard]] std::string read_image(std::size_t image) const;

 private:
  /// Numbers in a buffer: `count` elements of `components`, checked to lie within their buffer view.
  struct Numbers {
    const char* first;
    std::size_t count, components, stride;
    int type;
    [[nodiscard]] double at(std::size_t element, std::size_t component) const;
  };
  [[nodiscard]] Numbers locate(const nlohmann::json& holder, std::size_t count, std::size_t components, int type) const;
  [[nodiscard]] std::string read_uri(const std::string& uri, const std::string& holder) const;
  [[noreturn]] void fail(const std::string& problem) const;

  std::filesystem::path path_;
  std::string where_;
  std::string bytes_;  ///< of the main file
  nlohmann::json json_;
  std::vector<std::string> buffers_;
};

}  // namespace earshot
