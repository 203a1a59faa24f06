#include "trainer/checkpoint.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <limits>
#include <msgpack.hpp>
#include <span>

#include "sim/base/errors.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

static_assert(std::endian::native == std::endian::little, "tensors are written as they lie in memory");

constexpr std::string_view kMagic{"EARSHOT\0", 8};
constexpr std::uint32_t kVersion = 1;
constexpr std::size_t kHeaderBytes = kMagic.size() + sizeof(std::uint32_t) + sizeof(std::uint64_t);  // magic, version, length of the body
constexpr std::size_t kHashBytes = sizeof(std::uint64_t);
constexpr std::size_t kMaxFileBytes = std::size_t{4} << 30;
constexpr std::uint32_t kMaxDimensions = 8;
constexpr std::size_t kMaxItems = 65536;  // of a list or map: a forged count cannot make the decoder allocate much

struct NamedType {
  std::string_view name;
  torch::ScalarType type;
};
constexpr std::array<NamedType, 6> kTypes{{{"float32", torch::kFloat32},
                                           {"float64", torch::kFloat64},
                                           {"int64", torch::kInt64},
                                           {"int32", torch::kInt32},
                                           {"uint8", torch::kUInt8},
                                           {"bool", torch::kBool}}};

/// Appends to the string that becomes the file, so that the body is never copied.
struct StringStream {
  std::string& bytes;
  void write(const char* data, std::size_t size) { bytes.append(data, size); }
};
using Packer = msgpack::packer<StringStream>;

void pack_bytes(Packer& packer, const void* data, std::size_t size) {
  if (size > std::numeric_limits<std::uint32_t>::max())
    throw RunError("checkpoint", fmt::format("a field of {} bytes is over the format's 4 GiB", size));
  packer.pack_bin(static_cast<std::uint32_t>(size));
  packer.pack_bin_body(static_cast<const char*>(data), static_cast<std::uint32_t>(size));
}

void pack_tensor(Packer& packer, const torch::Tensor& tensor) {
  const torch::Tensor flat = tensor.detach().cpu().contiguous();
  const auto* known = std::find_if(kTypes.begin(), kTypes.end(), [&](const NamedType& type) { return type.type == flat.scalar_type(); });
  if (known == kTypes.end())
    throw RunError("checkpoint", fmt::format("cannot hold tensors of type {}", torch::toString(flat.scalar_type())));
  packer.pack_map(3);
  packer.pack("dtype").pack(std::string(known->name));
  packer.pack("shape").pack(flat.sizes().vec());
  packer.pack("data");
  pack_bytes(packer, flat.data_ptr(), flat.nbytes());
}

void pack_tensors(Packer& packer, const std::map<std::string, torch::Tensor>& tensors) {
  packer.pack_map(static_cast<std::uint32_t>(tensors.size()));
  for (const auto& [name, tensor] : tensors) {
    packer.pack(name);
    pack_tensor(packer, tensor);
  }
}

void pack_tensors(Packer& packer, const std::vector<torch::Tensor>& tensors) {
  packer.pack_array(static_cast<std::uint32_t>(tensors.size()));
  for (const auto& tensor : tensors) pack_tensor(packer, tensor);
}

void pack_body(Packer& packer, const Checkpoint& checkpoint) {
  packer.pack_map(11);
  packer.pack("config_yaml").pack(checkpoint.config_yaml);
  packer.pack("architecture").pack(checkpoint.architecture);
  packer.pack("update").pack(checkpoint.update);
  packer.pack("env_steps").pack(checkpoint.env_steps);
  packer.pack("seed").pack(checkpoint.seed);
  packer.pack("world_size").pack(checkpoint.world_size);
  packer.pack("weights");
  pack_tensors(packer, checkpoint.weights);
  packer.pack("optimizer");
  pack_tensors(packer, checkpoint.optimizer);
  packer.pack("env_states").pack_array(static_cast<std::uint32_t>(checkpoint.env_states.size()));
  for (const auto& state : checkpoint.env_states) pack_bytes(packer, state.data(), state.size());
  packer.pack("hidden");
  pack_tensors(packer, checkpoint.hidden);
  packer.pack("not_done");
  pack_tensors(packer, checkpoint.not_done);
}

/// Reads one checkpoint body; every failure is an InputError that names the file and the field.
class BodyReader {
 public:
  explicit BodyReader(std::string where) : where_(std::move(where)) {}

  Checkpoint read(const msgpack::object& body) {
    Checkpoint checkpoint;
    checkpoint.config_yaml = value<std::string>(body, "config_yaml");
    checkpoint.architecture = value<std::string>(body, "architecture");
    checkpoint.update = value<std::uint64_t>(body, "update");
    checkpoint.env_steps = value<std::uint64_t>(body, "env_steps");
    checkpoint.seed = value<std::uint64_t>(body, "seed");
    checkpoint.world_size = value<int>(body, "world_size");
    checkpoint.weights = named_tensors(body, "weights");
    checkpoint.optimizer = named_tensors(body, "optimizer");
    for (const auto& state : items(field(body, "env_states"), "env_states")) checkpoint.env_states.emplace_back(bytes(state, "env_states"));
    checkpoint.hidden = tensors(body, "hidden");
    checkpoint.not_done = tensors(body, "not_done");
    return checkpoint;
  }

 private:
  [[noreturn]] void fail(std::string_view name, std::string_view what) const {
    throw InputError(where_, fmt::format("is no valid checkpoint: '{}' {}", name, what), "take another checkpoint");
  }

  [[nodiscard]] const msgpack::object& field(const msgpack::object& map, std::string_view name) const {
    if (map.type != msgpack::type::MAP) fail(name, "is not in a map");
    for (const auto& [key, value] : std::span(map.via.map.ptr, map.via.map.size))
      if (key.type == msgpack::type::STR && std::string_view(key.via.str.ptr, key.via.str.size) == name) return value;
    fail(name, "is missing");
  }

  template <class T>
  [[nodiscard]] T value(const msgpack::object& map, std::string_view name) const {
    try {
      return field(map, name).as<T>();
    } catch (const msgpack::type_error&) {
      fail(name, "has another type");
    }
  }

  [[nodiscard]] std::span<const msgpack::object> items(const msgpack::object& list, std::string_view name) const {
    if (list.type != msgpack::type::ARRAY) fail(name, "is not a list");
    return {list.via.array.ptr, list.via.array.size};
  }

  [[nodiscard]] std::string_view bytes(const msgpack::object& object, std::string_view name) const {
    if (object.type != msgpack::type::BIN) fail(name, "is not bytes");
    return {object.via.bin.ptr, object.via.bin.size};
  }

  [[nodiscard]] torch::Tensor tensor(const msgpack::object& object, std::string_view name) const {
    const auto type_name = value<std::string>(object, "dtype");
    const auto* type = std::find_if(kTypes.begin(), kTypes.end(), [&](const NamedType& known) { return known.name == type_name; });
    if (type == kTypes.end()) fail(name, "has an unknown dtype");
    const std::string_view data = bytes(field(object, "data"), name);
    const auto shape = items(field(object, "shape"), name);
    if (shape.size() > kMaxDimensions) fail(name, "has too many dimensions");
    std::vector<std::int64_t> sizes;
    // The product never exceeds what the file holds, so it cannot overflow, nor can the allocation below outgrow the file.
    std::uint64_t size_bytes = torch::elementSize(type->type);
    bool empty = false;
    for (const auto& extent : shape) {
      if (extent.type != msgpack::type::POSITIVE_INTEGER || extent.via.u64 > kMaxFileBytes) fail(name, "has an impossible shape");
      sizes.push_back(static_cast<std::int64_t>(extent.via.u64));
      empty = empty || extent.via.u64 == 0;
      if (extent.via.u64 == 0) continue;
      if (size_bytes > kMaxFileBytes / extent.via.u64) fail(name, "has an impossible shape");
      size_bytes *= extent.via.u64;
    }
    if (data.size() != (empty ? 0 : size_bytes)) fail(name, "has a shape that does not fit its data");
    if (type->type == torch::kBool)
      for (const char byte : data)
        if (byte != 0 && byte != 1) fail(name, "holds booleans that are neither 0 nor 1");
    torch::Tensor tensor = torch::empty(sizes, type->type);
    if (!data.empty()) std::memcpy(tensor.data_ptr(), data.data(), data.size());
    return tensor;
  }

  [[nodiscard]] std::vector<torch::Tensor> tensors(const msgpack::object& body, std::string_view name) const {
    std::vector<torch::Tensor> list;
    for (const auto& item : items(field(body, name), name)) list.push_back(tensor(item, name));
    return list;
  }

  [[nodiscard]] std::map<std::string, torch::Tensor> named_tensors(const msgpack::object& body, std::string_view name) const {
    const msgpack::object& map = field(body, name);
    if (map.type != msgpack::type::MAP) fail(name, "is not a map");
    std::map<std::string, torch::Tensor> named;
    for (const auto& [key, item] : std::span(map.via.map.ptr, map.via.map.size)) {
      if (key.type != msgpack::type::STR) fail(name, "has a key that is no name");
      const std::string tensor_name(key.via.str.ptr, key.via.str.size);
      if (!named.emplace(tensor_name, tensor(item, name)).second) fail(name, "has a name twice");
    }
    return named;
  }

  std::string where_;
};

template <class T>
T read_little_endian(std::string_view bytes, std::size_t at) {
  T value;
  std::memcpy(&value, bytes.data() + at, sizeof(value));
  return value;
}

template <class T>
void write_little_endian(std::string& bytes, std::size_t at, T value) {
  std::memcpy(bytes.data() + at, &value, sizeof(value));
}

/// The body, once header and hash have been found good.
std::string_view checked_body(std::string_view file, const std::string& where) {
  const std::string remedy = "take another checkpoint";
  if (file.size() < kHeaderBytes + kHashBytes || file.substr(0, kMagic.size()) != kMagic)
    throw InputError(where, "is not an Earshot checkpoint", "name a file that earshot train wrote");
  const auto version = read_little_endian<std::uint32_t>(file, kMagic.size());
  if (version != kVersion)
    throw InputError(where, fmt::format("has checkpoint version {}, this program reads version {}", version, kVersion),
                     "use the program that wrote it");
  const auto length = read_little_endian<std::uint64_t>(file, kMagic.size() + sizeof(version));
  const std::size_t present = file.size() - kHeaderBytes - kHashBytes;
  if (length != present)
    throw InputError(where, fmt::format("is truncated or padded: {} bytes announced, {} there", length, present), remedy);
  const std::string_view body = file.substr(kHeaderBytes, present);
  if (hash64(body) != read_little_endian<std::uint64_t>(file, kHeaderBytes + present))
    throw InputError(where, "is damaged: its hash does not match", remedy);
  return body;
}

}  // namespace

void save_checkpoint(const Checkpoint& checkpoint, const std::filesystem::path& path) {
  std::string file(kHeaderBytes, '\0');
  std::size_t expected = kHeaderBytes + kHashBytes;
  for (const auto* tensors : {&checkpoint.weights, &checkpoint.optimizer})
    for (const auto& [name, tensor] : *tensors) expected += tensor.nbytes() + 256;
  file.reserve(expected + (std::size_t{1} << 20));
  StringStream stream{file};
  Packer packer(stream);
  pack_body(packer, checkpoint);

  const std::size_t length = file.size() - kHeaderBytes;
  if (file.size() + kHashBytes > kMaxFileBytes)
    throw RunError(path.string(), fmt::format("{} bytes are more than a checkpoint can hold", file.size()));
  file.replace(0, kMagic.size(), kMagic);
  write_little_endian(file, kMagic.size(), kVersion);
  write_little_endian(file, kMagic.size() + sizeof(kVersion), static_cast<std::uint64_t>(length));
  const std::uint64_t hash = hash64(std::string_view(file).substr(kHeaderBytes));
  file.resize(file.size() + kHashBytes);
  write_little_endian(file, file.size() - kHashBytes, hash);
  write_file_atomically(path, file);
}

Checkpoint load_checkpoint(const std::filesystem::path& path) { return decode_checkpoint(read_file(path, kMaxFileBytes), path.string()); }

Checkpoint decode_checkpoint(std::string_view bytes, const std::string& where) {
  const std::string_view body = checked_body(bytes, where);
  msgpack::object_handle handle;
  try {
    std::size_t offset = 0;
    // Bytes and texts stay where they are in `bytes`; lists and maps are short, and nothing nests deeper than the format does.
    const std::size_t limit = body.size();
    handle = msgpack::unpack(
        body.data(), body.size(), offset, [](msgpack::type::object_type, std::size_t, void*) { return true; }, nullptr,
        msgpack::unpack_limit(kMaxItems, kMaxItems, limit, limit, 0, 8));
    if (offset != body.size()) throw InputError(where, "has bytes after its end", "take another checkpoint");
  } catch (const InputError&) {
    throw;
  } catch (const std::exception& error) {  // msgpack throws several unrelated types
    throw InputError(where, fmt::format("is no valid checkpoint: {}", error.what()), "take another checkpoint");
  }
  return BodyReader(where).read(handle.get());
}

}  // namespace earshot
