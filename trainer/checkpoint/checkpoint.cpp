// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/checkpoint.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <limits>
#include <span>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/regular_file.h"
#include "trainer/checkpoint/checkpoint_format.h"

namespace earshot {
namespace {

static_assert(std::endian::native == std::endian::little, "tensors are written as they lie in memory");

constexpr std::uint32_t kMaxDimensions = 8;

struct NamedType {
  std::string_view name;
  torch::ScalarType type;
};
constexpr std::array<NamedType, 7> kTypes{{{"float32", torch::kFloat32},
                                           {"float16", torch::kFloat16},
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
    throw RunError("checkpoint", fmt::format("a field of {} bytes exceeds the limit of the format, 4 GiB", size));
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
  packer.pack_map(20u + (checkpoint.held_out ? 1u : 0u) + (checkpoint.module ? 1u : 0u));
  packer.pack("config_yaml").pack(checkpoint.config_yaml);
  packer.pack("architecture").pack(checkpoint.architecture);
  packer.pack("update").pack(checkpoint.update);
  packer.pack("env_steps").pack(checkpoint.env_steps);
  packer.pack("seed").pack(checkpoint.seed);
  packer.pack("world_size").pack(checkpoint.world_size);
  packer.pack("engine").pack(checkpoint.engine);
  packer.pack("engine_commit").pack(checkpoint.engine_commit);
  packer.pack("elapsed_s").pack(checkpoint.elapsed_s);
  packer.pack("mean_reward").pack(checkpoint.mean_reward);
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
  packer.pack("oracle_acted");
  pack_tensors(packer, checkpoint.oracle_acted);
  packer.pack("episode_window").pack(checkpoint.episode_window);
  packer.pack("episode_window_fields").pack(checkpoint.episode_window_fields);
  packer.pack("members").pack(checkpoint.members);
  packer.pack("started_workers").pack(checkpoint.started_workers);
  if (checkpoint.held_out) packer.pack("held_out").pack(encode_held_out(*checkpoint.held_out));
  if (!checkpoint.module) return;
  packer.pack("module");
  pack_bytes(packer, checkpoint.module->data(), checkpoint.module->size());
}

/// Adds the tensors to what CheckpointFields reads.
class BodyReader : CheckpointFields {
 public:
  using CheckpointFields::CheckpointFields;

  [[nodiscard]] Checkpoint read(const msgpack::object& body) const {
    Checkpoint checkpoint{metadata(body), {}, {}, {}, {}, {}, {}, {}};
    checkpoint.weights = named_tensors(body, "weights");
    checkpoint.optimizer = named_tensors(body, "optimizer");
    for (const auto& state : items(field(body, "env_states"), "env_states")) checkpoint.env_states.emplace_back(bytes(state, "env_states"));
    checkpoint.hidden = tensors(body, "hidden");
    checkpoint.not_done = tensors(body, "not_done");
    if (has(body, "oracle_acted")) checkpoint.oracle_acted = tensors(body, "oracle_acted");
    checkpoint.episode_window = value<std::vector<double>>(body, "episode_window");
    constexpr int fields_of_old = 9;  // before files said
    checkpoint.episode_window_fields = has(body, "episode_window_fields") ? value<int>(body, "episode_window_fields") : fields_of_old;
    read_members(body, checkpoint);
    if (has(body, "module")) checkpoint.module = std::make_shared<const std::string>(bytes(field(body, "module"), "module"));
    return checkpoint;
  }

 private:
  void read_members(const msgpack::object& body, Checkpoint& checkpoint) const {
    if (has(body, "members")) {
      checkpoint.members = value<std::vector<int>>(body, "members");
      checkpoint.started_workers = value<int>(body, "started_workers");
    }
    if (checkpoint.members.empty()) return;
    int least = 0;
    for (const int member : checkpoint.members) {
      if (member < least || member >= checkpoint.started_workers) fail("members", "does not list the workers in rank order");
      least = member + 1;
    }
    if (checkpoint.members.size() != static_cast<std::size_t>(checkpoint.world_size)) fail("members", "does not have one entry per worker");
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
      if (extent.type != msgpack::type::POSITIVE_INTEGER || extent.via.u64 > kMaxCheckpointBytes) fail(name, "has an invalid shape");
      sizes.push_back(static_cast<std::int64_t>(extent.via.u64));
      empty = empty || extent.via.u64 == 0;
      if (extent.via.u64 == 0) continue;
      if (size_bytes > kMaxCheckpointBytes / extent.via.u64) fail(name, "has an invalid shape");
      size_bytes *= extent.via.u64;
    }
    if (data.size() != (empty ? 0 : size_bytes)) fail(name, "has a shape that does not fit its data");
    if (type->type == torch::kBool)
      for (const char byte : data)
        if (byte != 0 && byte != 1) fail(name, "contains booleans other than 0 and 1");
    torch::Tensor tensor = torch::empty(sizes, type->type);
    if (!data.empty()) std::memcpy(tensor.data_ptr(), data.data(), data.size());
    return type->type == torch::kFloat16 ? tensor.to(torch::kFloat32) : tensor;  // exact; nothing computes with halves
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
      if (key.type != msgpack::type::STR) fail(name, "has a key that is not a string");
      const std::string tensor_name(key.via.str.ptr, key.via.str.size);
      if (!named.emplace(tensor_name, tensor(item, name)).second) fail(name, "contains the same name twice");
    }
    return named;
  }
};

template <class T>
void write_little_endian(std::string& bytes, std::size_t at, T value) {
  std::memcpy(bytes.data() + at, &value, sizeof(value));
}

}  // namespace

std::string encode_checkpoint(const Checkpoint& checkpoint, const std::string& where) {
  std::string file(kCheckpointHeaderBytes, '\0');
  std::size_t expected = kCheckpointHeaderBytes + kCheckpointHashBytes;
  for (const auto* tensors : {&checkpoint.weights, &checkpoint.optimizer})
    for (const auto& [name, tensor] : *tensors) expected += tensor.nbytes() + 256;
  file.reserve(expected + (std::size_t{1} << 20));
  StringStream stream{file};
  Packer packer(stream);
  pack_body(packer, checkpoint);

  const std::size_t length = file.size() - kCheckpointHeaderBytes;
  if (file.size() + kCheckpointHashBytes > kMaxCheckpointBytes)
    throw RunError(where, fmt::format("{} bytes exceed the limit of a checkpoint", file.size()));
  file.replace(0, kCheckpointMagic.size(), kCheckpointMagic);
  write_little_endian(file, kCheckpointMagic.size(), kCheckpointVersion);
  write_little_endian(file, kCheckpointMagic.size() + sizeof(kCheckpointVersion), static_cast<std::uint64_t>(length));
  const std::uint64_t hash = hash64(std::string_view(file).substr(kCheckpointHeaderBytes));
  file.resize(file.size() + kCheckpointHashBytes);
  write_little_endian(file, file.size() - kCheckpointHashBytes, hash);
  return file;
}

void save_checkpoint(const Checkpoint& checkpoint, const std::filesystem::path& path) {
  write_file_atomically(path, encode_checkpoint(checkpoint, path.string()));
}

Checkpoint load_checkpoint(const std::filesystem::path& path) {
  return decode_checkpoint(read_regular_file(path, kMaxCheckpointBytes), path.string());
}

Checkpoint decode_checkpoint(std::string_view bytes, const std::string& where) {
  const msgpack::object_handle body = unpack_checkpoint(bytes, where);
  return BodyReader(where).read(body.get());
}

}  // namespace earshot
