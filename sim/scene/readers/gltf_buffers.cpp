// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/readers/gltf_buffers.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <optional>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"
#include "sim/base/text/json_depth.h"

namespace earshot {
namespace {

using Json = nlohmann::json;

constexpr std::size_t largest_count = std::size_t{1} << 28;  // of elements without bytes behind them (sparse on zeros)

std::uint32_t little_endian32(std::string_view bytes, std::size_t at) {
  std::uint32_t value = 0;
  for (unsigned i = 4; i-- > 0;) value = value << 8 | static_cast<unsigned char>(bytes[at + i]);
  return value;
}

std::optional<std::string> decode_base64(std::string_view text) {
  std::string bytes;
  bytes.reserve(text.size() / 4 * 3);
  std::uint32_t word = 0;
  int bits = 0;
  for (const char letter : text) {
    std::uint32_t value;
    if (letter >= 'A' && letter <= 'Z')
      value = static_cast<std::uint32_t>(letter - 'A');
    else if (letter >= 'a' && letter <= 'z')
      value = static_cast<std::uint32_t>(letter - 'a' + 26);
    else if (letter >= '0' && letter <= '9')
      value = static_cast<std::uint32_t>(letter - '0' + 52);
    else if (letter == '+')
      value = 62;
    else if (letter == '/')
      value = 63;
    else if (letter == '=')
      break;
    else
      return std::nullopt;
    word = word << 6 | value;
    bits += 6;
    if (bits >= 8) {
      bits -= 8;
      bytes.push_back(static_cast<char>(word >> bits & 0xFFu));
    }
  }
  return bytes;
}

std::string decode_percent(std::string_view uri) {
  const auto digit = [](char c) { return c >= '0' && c <= '9' ? c - '0' : (c | 32) >= 'a' && (c | 32) <= 'f' ? (c | 32) - 'a' + 10 : -1; };
  std::string path;
  for (std::size_t i = 0; i < uri.size(); ++i) {
    if (uri[i] == '%' && i + 2 < uri.size() && digit(uri[i + 1]) >= 0 && digit(uri[i + 2]) >= 0) {
      path.push_back(static_cast<char>(digit(uri[i + 1]) * 16 + digit(uri[i + 2])));
      i += 2;
    } else {
      path.push_back(uri[i]);
    }
  }
  return path;
}

std::size_t size_of_component(int type) {
  switch (type) {
    case 5120:
    case 5121:
      return 1;
    case 5122:
    case 5123:
      return 2;
    case 5125:
    case 5126:
      return 4;
    default:
      return 0;
  }
}

/// Range of a normalized integer type (glTF 2.0, section 3.11).
double normalizer(int type) {
  switch (type) {
    case 5120:
      return 127;
    case 5121:
      return 255;
    case 5122:
      return 32767;
    case 5123:
      return 65535;
    default:
      return 1;
  }
}

template <class T>
double load(const char* from) {
  T value;
  std::memcpy(&value, from, sizeof value);
  return static_cast<double>(value);
}

/// A whole number that is there or has a default; wrong types throw.
std::size_t read_size(const Json& json, const char* key, std::optional<std::size_t> fallback = std::nullopt) {
  if (fallback && !json.contains(key)) return *fallback;
  const Json& value = json.at(key);
  if (!value.is_number_unsigned()) throw Json::other_error::create(600, fmt::format("'{}' is not a whole number", key), &value);
  return value.get<std::size_t>();
}

}  // namespace

void GltfAsset::fail(const std::string& problem) const { throw InputError(where_, problem, "export the file again"); }

GltfAsset::GltfAsset(const std::filesystem::path& path) : path_(path), where_(path.string()), bytes_(read_file(path)) {
  std::string_view text = bytes_;
  std::string_view binary_chunk;
  if (text.starts_with("glTF")) {
    if (text.size() < 20 || little_endian32(text, 4) != 2 || little_endian32(text, 8) > text.size())
      fail("is not a complete GLB file of version 2");
    const std::size_t json_size = little_endian32(text, 12);
    if (json_size > text.size() - 20 || little_endian32(text, 16) != 0x4E4F534Au) fail("is truncated in its JSON chunk");
    const std::size_t binary_at = 20 + (json_size + 3) / 4 * 4;
    if (binary_at + 8 <= text.size() && little_endian32(text, binary_at + 4) == 0x004E4942u) {
      const std::size_t binary_size = little_endian32(text, binary_at);
      if (binary_size > text.size() - binary_at - 8) fail("is truncated in its binary chunk");
      binary_chunk = text.substr(binary_at + 8, binary_size);
    }
    text = text.substr(20, json_size);
  }
  check_json_depth(text, where_);
  try {
    json_ = parse_json(text);
  } catch (const Json::parse_error& error) {
    fail(fmt::format("is not glTF: JSON error at byte {}", error.byte));
  }
  if (!json_.is_object() || !json_.contains("asset")) fail("is not glTF: it has no 'asset'");
  const auto version = json_["asset"].value("version", std::string());
  if (version != "2" && !version.starts_with("2.")) fail("is not glTF version 2");

  const Json no_buffers = Json::array();
  const Json& buffers = json_.contains("buffers") ? json_["buffers"] : no_buffers;
  for (std::size_t i = 0; i < buffers.size(); ++i) {
    const std::size_t size = read_size(buffers.at(i), "byteLength");
    std::string bytes;
    if (!buffers[i].contains("uri")) {
      // The chunk is the first buffer; others without data are placeholders of a compression.
      if (i == 0) bytes = binary_chunk;
    } else {
      bytes = read_uri(buffers[i]["uri"].get<std::string>(), fmt::format("buffer {}", i));
    }
    if (bytes.size() < size) fail(fmt::format("buffer {} has {} bytes instead of {}", i, bytes.size(), size));
    buffers_.push_back(std::move(bytes));
  }
}

std::string GltfAsset::read_uri(const std::string& uri, const std::string& holder) const {
  if (!uri.starts_with("data:")) return read_file(path_.parent_path() / decode_percent(uri));
  const std::size_t comma = uri.find(',');
  std::optional<std::string> decoded = decode_base64(std::string_view(uri).substr(comma == std::string::npos ? uri.size() : comma + 1));
  if (!decoded) fail(fmt::format("{} is not base64", holder));
  return std::move(*decoded);
}

std::string GltfAsset::read_image(std::size_t index) const {
  const Json& image = json_.at("images").at(index);
  if (image.contains("uri")) return read_uri(image["uri"].get<std::string>(), fmt::format("image {}", index));
  const Json& view = json_.at("bufferViews").at(read_size(image, "bufferView"));
  const std::string& buffer = buffers_.at(read_size(view, "buffer"));
  const std::size_t offset = read_size(view, "byteOffset", 0), size = read_size(view, "byteLength");
  if (offset > buffer.size() || size > buffer.size() - offset) fail("a buffer view exceeds its buffer");
  return buffer.substr(offset, size);
}

double GltfAsset::Numbers::at(std::size_t element, std::size_t component) const {
  const char* from = first + element * stride + component * size_of_component(type);
  switch (type) {
    case 5120:
      return load<std::int8_t>(from);
    case 5121:
      return load<std::uint8_t>(from);
    case 5122:
      return load<std::int16_t>(from);
    case 5123:
      return load<std::uint16_t>(from);
    case 5125:
      return load<std::uint32_t>(from);
    default:
      return load<float>(from);
  }
}

GltfAsset::Numbers GltfAsset::locate(const Json& holder, std::size_t count, std::size_t components, int type) const {
  const Json& view = json_.at("bufferViews").at(read_size(holder, "bufferView"));
  const std::string& buffer = buffers_.at(read_size(view, "buffer"));
  const std::size_t element = components * size_of_component(type);
  if (element == 0) fail(fmt::format("component type {} is unknown", type));
  const std::size_t view_offset = read_size(view, "byteOffset", 0), view_size = read_size(view, "byteLength");
  const std::size_t offset = read_size(holder, "byteOffset", 0), stride = read_size(view, "byteStride", element);
  if (view_offset > buffer.size() || view_size > buffer.size() - view_offset) fail("a buffer view exceeds its buffer");
  // The last element needs no whole stride.
  if (stride < element || stride > 4096 || offset > view_size || count > view_size ||
      (count > 0 && stride * (count - 1) + element > view_size - offset)) {
    fail("an accessor exceeds its buffer view");
  }
  return {buffer.data() + view_offset + offset, count, components, stride, type};
}

std::vector<double> GltfAsset::read_accessor(std::size_t index, std::size_t components) const {
  const Json& accessor = json_.at("accessors").at(index);
  const std::string shape = accessor.at("type").get<std::string>();
  constexpr const char* shapes[] = {"SCALAR", "VEC2", "VEC3", "VEC4"};
  EARSHOT_EXPECT(components >= 1 && components <= 4);
  if (shape != shapes[components - 1]) fail(fmt::format("accessor {} is {}", index, shape));
  const std::size_t count = read_size(accessor, "count");
  const int type = static_cast<int>(std::min<std::size_t>(read_size(accessor, "componentType"), 1u << 20));
  const double scale = accessor.value("normalized", false) ? 1.0 / normalizer(type) : 1.0;
  if (count > largest_count) fail(fmt::format("accessor {} has {} elements", index, count));
  std::vector<double> values;
  if (accessor.contains("bufferView")) {
    const Numbers numbers = locate(accessor, count, components, type);
    values.resize(count * components);
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = scale * numbers.at(i / components, i % components);
  } else if (accessor.contains("sparse")) {
    values.resize(count * components);
  } else {
    fail(fmt::format("accessor {} has no data", index));
  }
  if (accessor.contains("sparse")) {
    const Json& sparse = accessor["sparse"];
    const std::size_t changed = read_size(sparse, "count");
    const Json& where = sparse.at("indices");
    const int where_type = static_cast<int>(std::min<std::size_t>(read_size(where, "componentType"), 1u << 20));
    const Numbers places = locate(where, changed, 1, where_type), news = locate(sparse.at("values"), changed, components, type);
    for (std::size_t i = 0; i < changed; ++i) {
      const double place = places.at(i, 0);
      if (!(place >= 0 && place < static_cast<double>(count)))
        fail(fmt::format("sparse accessor {} changes element {} of {}", index, place, count));
      for (std::size_t c = 0; c < components; ++c) values[static_cast<std::size_t>(place) * components + c] = scale * news.at(i, c);
    }
  }
  return values;
}

std::vector<glm::dvec3> GltfAsset::read_positions(std::size_t accessor) const {
  const std::vector<double> values = read_accessor(accessor, 3);
  std::vector<glm::dvec3> positions(values.size() / 3);
  for (std::size_t i = 0; i < positions.size(); ++i) positions[i] = glm::dvec3(values[3 * i], values[3 * i + 1], values[3 * i + 2]);
  return positions;
}

std::vector<std::uint32_t> GltfAsset::read_indices(std::size_t accessor) const {
  const std::size_t type = read_size(json_.at("accessors").at(accessor), "componentType");
  if (type != 5121 && type != 5123 && type != 5125) fail(fmt::format("index accessor {} does not contain unsigned integers", accessor));
  const std::vector<double> values = read_accessor(accessor, 1);
  return {values.begin(), values.end()};
}

}  // namespace earshot
