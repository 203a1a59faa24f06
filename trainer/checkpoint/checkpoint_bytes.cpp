// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/checkpoint_bytes.h"

#include "envs/batch/env_state.h"
#include "sim/base/errors.h"
#include "sim/base/regular_file.h"
#include "trainer/checkpoint/checkpoint_format.h"

namespace earshot {

CheckpointBytes read_checkpoint(const std::filesystem::path& folder_or_file, std::size_t max_bytes) {
  constexpr int tries = 5;
  for (int i = 1;; ++i) {
    const std::filesystem::path path = find_checkpoint(folder_or_file, max_bytes);
    try {
      return {path, read_regular_file(path, max_bytes)};
    } catch (const InputError&) {
      if (i == tries || std::filesystem::exists(path)) throw;
    }
  }
}

CheckpointMetadata metadata_of(const CheckpointBytes& checkpoint) {
  const std::string where = checkpoint.path.string();
  const msgpack::object_handle body = unpack_checkpoint(checkpoint.bytes, where);
  return CheckpointFields(where).metadata(body.get());
}

std::optional<std::uint64_t> episode_set_of(const CheckpointBytes& checkpoint) {
  constexpr const char* states = "env_states";
  const std::string where = checkpoint.path.string();
  const msgpack::object_handle body = unpack_checkpoint(checkpoint.bytes, where);
  const CheckpointFields fields(where);
  const auto of_ranks = fields.items(fields.field(body.get(), states), states);
  if (of_ranks.empty()) return std::nullopt;
  return decode_env_state(fields.bytes(of_ranks.front(), states)).set_hash;
}

}  // namespace earshot
