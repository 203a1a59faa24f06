// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/checkpoint_format.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/schema_version.h"

namespace earshot {
namespace {

constexpr std::size_t kMaxItems = 65536;  // of a list or map: a forged count cannot make the decoder allocate much

template <class T>
T read_little_endian(std::string_view bytes, std::size_t at) {
  T value;
  std::memcpy(&value, bytes.data() + at, sizeof(value));
  return value;
}

/// The body, once header and hash have been found good.
std::string_view checked_body(std::string_view file, const std::string& where) {
  const std::string remedy = "use another checkpoint";
  if (file.size() < kCheckpointHeaderBytes + kCheckpointHashBytes || file.substr(0, kCheckpointMagic.size()) != kCheckpointMagic)
    throw InputError(where, "is not an Earshot checkpoint", "use a file written by 'earshot train'");
  const auto version = read_little_endian<std::uint32_t>(file, kCheckpointMagic.size());
  check_schema_version(where, "a checkpoint", version, {kCheckpointVersion, kCheckpointVersion});
  const auto length = read_little_endian<std::uint64_t>(file, kCheckpointMagic.size() + sizeof(version));
  const std::size_t present = file.size() - kCheckpointHeaderBytes - kCheckpointHashBytes;
  if (length != present)
    throw InputError(where, fmt::format("has the wrong size: the header announces {} bytes, the file has {}", length, present), remedy);
  const std::string_view body = file.substr(kCheckpointHeaderBytes, present);
  if (hash64(body) != read_little_endian<std::uint64_t>(file, kCheckpointHeaderBytes + present))
    throw InputError(where, "is corrupted: its hash does not match", remedy);
  return body;
}

}  // namespace

msgpack::object_handle unpack_checkpoint(std::string_view file, const std::string& where) {
  const std::string_view body = checked_body(file, where);
  try {
    std::size_t offset = 0;
    // Bytes and texts stay where they are in `file`; lists and maps are short, and nothing nests deeper than the format does.
    const std::size_t limit = body.size();
    msgpack::object_handle handle = msgpack::unpack(
        body.data(), body.size(), offset, [](msgpack::type::object_type, std::size_t, void*) { return true; }, nullptr,
        msgpack::unpack_limit(kMaxItems, kMaxItems, limit, limit, 0, 8));
    if (offset != body.size()) throw InputError(where, "has extra bytes at its end", "use another checkpoint");
    return handle;
  } catch (const InputError&) {
    throw;
  } catch (const std::exception& error) {  // msgpack throws several unrelated types
    throw InputError(where, fmt::format("is not a valid checkpoint: {}", error.what()), "use another checkpoint");
  }
}

void CheckpointFields::fail(std::string_view name, std::string_view problem) const {
  throw InputError(where_, fmt::format("is not a valid checkpoint: '{}' {}", name, problem), "use another checkpoint");
}

bool CheckpointFields::has(const msgpack::object& map, std::string_view name) {
  if (map.type != msgpack::type::MAP) return false;
  const std::span entries(map.via.map.ptr, map.via.map.size);
  return std::any_of(entries.begin(), entries.end(), [&](const msgpack::object_kv& entry) {
    return entry.key.type == msgpack::type::STR && std::string_view(entry.key.via.str.ptr, entry.key.via.str.size) == name;
  });
}

const msgpack::object& CheckpointFields::field(const msgpack::object& map, std::string_view name) const {
  if (map.type != msgpack::type::MAP) fail(name, "is not in a map");
  for (const auto& [key, value] : std::span(map.via.map.ptr, map.via.map.size))
    if (key.type == msgpack::type::STR && std::string_view(key.via.str.ptr, key.via.str.size) == name) return value;
  fail(name, "is missing");
}

std::span<const msgpack::object> CheckpointFields::items(const msgpack::object& list, std::string_view name) const {
  if (list.type != msgpack::type::ARRAY) fail(name, "is not a list");
  return {list.via.array.ptr, list.via.array.size};
}

std::string_view CheckpointFields::bytes(const msgpack::object& object, std::string_view name) const {
  if (object.type != msgpack::type::BIN) fail(name, "is not bytes");
  return {object.via.bin.ptr, object.via.bin.size};
}

CheckpointMetadata CheckpointFields::metadata(const msgpack::object& body) const {
  CheckpointMetadata metadata;
  metadata.config_yaml = value<std::string>(body, "config_yaml");
  metadata.architecture = value<std::string>(body, "architecture");
  metadata.update = value<std::uint64_t>(body, "update");
  metadata.env_steps = value<std::uint64_t>(body, "env_steps");
  metadata.seed = value<std::uint64_t>(body, "seed");
  metadata.world_size = value<int>(body, "world_size");
  metadata.engine = value<std::string>(body, "engine");
  metadata.engine_commit = value<std::string>(body, "engine_commit");
  if (has(body, "elapsed_s")) metadata.elapsed_s = value<double>(body, "elapsed_s");
  if (!(metadata.elapsed_s >= 0 && metadata.elapsed_s < 1e12)) fail("elapsed_s", "is not a duration");
  metadata.mean_reward = value<double>(body, "mean_reward");
  if (has(body, "held_out")) try {
      metadata.held_out = decode_held_out(value<std::string>(body, "held_out"));
    } catch (const RunError&) {
      fail("held_out", "is not the state of evaluations");
    }
  metadata.is_policy = items(field(body, "env_states"), "env_states").empty();
  return metadata;
}

}  // namespace earshot
