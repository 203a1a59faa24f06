// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "sim/acoustics/source_field/source_field.h"

namespace earshot {

struct FieldStoreConfig {
  std::filesystem::path folder;                  ///< shared by threads, processes and runs; empty: nothing is kept on disk
  std::uint64_t max_bytes = 20'000'000'000;      ///< in that folder (image_store.h says how exactly)
  std::size_t max_memory_bytes = 0;              ///< of fields that are cached though no caller holds them; least recently used first
  std::function<void(const std::string&)> warn;  ///< damaged files, a folder that cannot be written; empty: silent
};

/// Where fields came from, since construction.
struct FieldCounters {
  std::uint64_t built = 0, loaded = 0;         ///< by this store; loaded: from the folder
  std::uint64_t shared = 0;                    ///< requests for fields that were in memory
  std::uint64_t bytes = 0;                     ///< of the images built and loaded
  double build_seconds = 0, load_seconds = 0;  ///< wall time, summed over threads
};

/// Source fields that are made once: cached in memory, and in a folder common to all agents, episodes, runs and worker processes.  A field
/// is always refined to the target of its config, so its bits do not depend on where it comes from.  Thread-safe; threads that request the
/// same field wait for one, and so do processes that share the folder: one builds, the others read.  After ten minutes, or where the folder
/// knows no locks, they build as well: either result is valid.
class SourceFieldStore {
 public:
  explicit SourceFieldStore(FieldStoreConfig config);
  ~SourceFieldStore();

  /// The field of this source.  Built with the threads of scene.config() unless it is in memory or in the folder; a field in the folder is
  /// read through pages common to all processes.  progress: of building.  Throws what building throws; never for what is on the disk.
  std::shared_ptr<const SourceField> get(const AcousticScene& scene, const EarlyCandidates& candidates,
                                         const std::function<void(double fraction)>& progress = {});
  [[nodiscard]] FieldCounters counters() const;
  [[nodiscard]] std::size_t cached_bytes() const;  ///< held by the store itself, at most max_memory_bytes

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace earshot
