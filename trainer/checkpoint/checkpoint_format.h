// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <msgpack.hpp>
#include <span>
#include <string>
#include <string_view>

#include "trainer/checkpoint/find_checkpoint.h"

namespace earshot {

/// The file format of checkpoints as far as it needs no tensors; for checkpoint.cpp and find_checkpoint.cpp only.
/// File: "EARSHOT\0", version (uint32), length of the body (uint64), body (MessagePack map), XXH3 of the body (uint64), little-endian.
constexpr std::string_view kCheckpointMagic{"EARSHOT\0", 8};
constexpr std::uint32_t kCheckpointVersion = 2;
constexpr std::size_t kCheckpointHeaderBytes = kCheckpointMagic.size() + sizeof(std::uint32_t) + sizeof(std::uint64_t);
constexpr std::size_t kCheckpointHashBytes = sizeof(std::uint64_t);

/// The body as objects that point into `file`.  Throws InputError: not a checkpoint, other version, truncated, hash mismatch, no
/// MessagePack.
msgpack::object_handle unpack_checkpoint(std::string_view file, const std::string& where);

/// Reads fields of the body; every failure is an InputError that names the file and the field.
class CheckpointFields {
 public:
  explicit CheckpointFields(std::string where) : where_(std::move(where)) {}

  [[noreturn]] void fail(std::string_view name, std::string_view problem) const;
  [[nodiscard]] static bool has(const msgpack::object& map, std::string_view name);
  [[nodiscard]] const msgpack::object& field(const msgpack::object& map, std::string_view name) const;
  [[nodiscard]] std::span<const msgpack::object> items(const msgpack::object& list, std::string_view name) const;
  [[nodiscard]] std::string_view bytes(const msgpack::object& object, std::string_view name) const;
  [[nodiscard]] CheckpointMetadata metadata(const msgpack::object& body) const;

  template <class T>
  [[nodiscard]] T value(const msgpack::object& map, std::string_view name) const {
    try {
      return field(map, name).template as<T>();
    } catch (const msgpack::type_error&) {
      fail(name, "has the wrong type");
    }
  }

 private:
  std::string where_;
};

}  // namespace earshot
