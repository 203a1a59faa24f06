// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "sim/base/text/json.h"

namespace earshot {

/// Builds small glTF files for tests; knows nothing of the reader.
class GltfWriter {
 public:
  nlohmann::json json = {{"asset", {{"version", "2.0"}}},          {"buffers", nlohmann::json::array()},
                         {"bufferViews", nlohmann::json::array()}, {"accessors", nlohmann::json::array()},
                         {"meshes", nlohmann::json::array()},      {"nodes", nlohmann::json::array()}};
  std::string bytes;

  template <class T>
  std::size_t add_view(const std::vector<T>& values, std::size_t stride = 0) {
    while (bytes.size() % 4) bytes.push_back('\0');
    nlohmann::json view{{"buffer", 0}, {"byteOffset", bytes.size()}, {"byteLength", values.size() * sizeof(T)}};
    if (stride) view["byteStride"] = stride;
    bytes.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
    json["bufferViews"].push_back(view);
    return json["bufferViews"].size() - 1;
  }
  std::size_t add_accessor(std::size_t view, std::size_t count, int component_type, const std::string& type) {
    json["accessors"].push_back({{"bufferView", view}, {"count", count}, {"componentType", component_type}, {"type", type}});
    return json["accessors"].size() - 1;
  }
  std::size_t add_positions(const std::vector<float>& xyz) { return add_accessor(add_view(xyz), xyz.size() / 3, 5126, "VEC3"); }

  /// With the buffer as base64 in the file.
  [[nodiscard]] std::string gltf() const {
    static const char* digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string text;
    for (std::size_t i = 0; i < bytes.size(); i += 3) {
      std::uint32_t word = 0;
      for (std::size_t j = 0; j < 3; ++j) word = word << 8 | (i + j < bytes.size() ? static_cast<unsigned char>(bytes[i + j]) : 0u);
      for (int j = 3; j >= 0; --j) text.push_back(digits[word >> (6 * j) & 63u]);
    }
    if (bytes.size() % 3) text.replace(text.size() - (3 - bytes.size() % 3), 3 - bytes.size() % 3, bytes.size() % 3 == 1 ? "==" : "=");
    nlohmann::json whole = json;
    whole["buffers"] = {{{"byteLength", bytes.size()}, {"uri", "data:application/octet-stream;base64," + text}}};
    return json_text(whole);
  }
  [[nodiscard]] std::string glb() const {
    nlohmann::json whole = json;
    whole["buffers"] = {{{"byteLength", bytes.size()}}};
    std::string text = json_text(whole), binary = bytes;
    while (text.size() % 4) text.push_back(' ');
    while (binary.size() % 4) binary.push_back('\0');
    const auto word = [](std::size_t value) {
      const auto narrow = static_cast<std::uint32_t>(value);
      std::string four(4, '\0');
      std::memcpy(four.data(), &narrow, 4);
      return four;
    };
    return "glTF" + word(2) + word(28 + text.size() + binary.size()) + word(text.size()) + "JSON" + text + word(binary.size()) +
           std::string("BIN\0", 4) + binary;
  }
};

}  // namespace earshot
