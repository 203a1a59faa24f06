// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/find_checkpoint.h"

#include <fmt/format.h>

#include "sim/base/errors.h"
#include "sim/base/regular_file.h"
#include "sim/base/text/log.h"
#include "trainer/checkpoint/checkpoint_format.h"
#include "trainer/checkpoint/run_folder.h"

namespace earshot {

CheckpointMetadata load_checkpoint_metadata(const std::filesystem::path& path, std::size_t max_bytes) {
  const std::string bytes = read_regular_file(path, max_bytes);
  const msgpack::object_handle body = unpack_checkpoint(bytes, path.string());
  return CheckpointFields(path.string()).metadata(body.get());
}

std::filesystem::path find_checkpoint(const std::filesystem::path& folder_or_file, std::size_t max_bytes) {
  if (std::filesystem::is_regular_file(folder_or_file)) return folder_or_file;
  std::filesystem::path newest;
  std::uint64_t newest_update = 0;
  std::string damaged;
  // In the order of names, so that of equals the one named by its update is taken.
  for (const auto& file : RunFolder(folder_or_file).checkpoints()) {
    try {
      const std::uint64_t update = load_checkpoint_metadata(file, max_bytes).update;
      if (newest.empty() || update >= newest_update) {
        newest = file;
        newest_update = update;
      }
    } catch (const InputError& error) {
      if (!std::filesystem::exists(file)) continue;  // a run that is under way has removed it meanwhile
      damaged = error.what();
      log_warning(fmt::format("skipped a damaged checkpoint: {}", damaged));
    }
  }
  if (!newest.empty()) return newest;
  if (!damaged.empty())
    throw InputError(folder_or_file.string(), "contains only damaged checkpoints: " + damaged, "start a new run, or restore a copy");
  throw InputError(folder_or_file.string(), "contains no checkpoint (*.ckpt)", "give a run folder or a checkpoint file");
}

}  // namespace earshot
