// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

namespace earshot {

/// The files that one run writes under its `out`:
///   checkpoints/update_NNNNNN.ckpt   one per `checkpoint_every` updates, of which the newest `keep` stay
///   checkpoints/best.ckpt            the best so far (checkpoint_keeper.h)
///   checkpoints/last.ckpt            of the end of the run
/// run.lock                         holder of the lock while the run is under way (run_lock.h)
///   acoustics_HASH.yaml              what env.accuracy came to (planned_acoustics.h); stays when a run is overwritten
///   events.jsonl, events.out.tfevents.*, curve.svg, quarantine/FAULT_HASH.json
/// Every other file there belongs to the user and is never removed.
class RunFolder {
 public:
  explicit RunFolder(std::filesystem::path out) : out_(std::move(out)) {}

  [[nodiscard]] const std::filesystem::path& path() const { return out_; }
  [[nodiscard]] std::filesystem::path checkpoint_of(std::uint64_t update) const;
  [[nodiscard]] std::filesystem::path last_checkpoint() const { return out_ / "checkpoints" / "last.ckpt"; }
  [[nodiscard]] std::filesystem::path best_checkpoint() const { return out_ / "checkpoints" / "best.ckpt"; }
  [[nodiscard]] std::filesystem::path event_log() const { return out_ / "events.jsonl"; }
  [[nodiscard]] std::filesystem::path curve() const { return out_ / "curve.svg"; }
  [[nodiscard]] std::filesystem::path lock_file() const { return out_ / "run.lock"; }

  /// All *.ckpt in the folder and in checkpoints/ by name: the candidates of find_checkpoint.
  [[nodiscard]] std::vector<std::filesystem::path> checkpoints() const;
  /// Removes the files above.  Throws InputError, and removes nothing, if a checkpoint of another name is there: it would be taken for one
  /// of the next run.
  void remove_run() const;
  /// Removes the oldest periodic checkpoint and returns it; nullopt, and nothing is removed, where no newer one is whole.
  /// Throws std::filesystem::filesystem_error.
  [[nodiscard]] std::optional<std::filesystem::path> drop_oldest() const;
  /// Removes what killed writers left of checkpoints that they had not finished.
  void remove_temporaries() const;
  /// Removes what the bound on checkpoints leaves over once the one of `update` is on disk: those of the `keep` newest updates stay, those
  /// of later updates go (a resumed run makes them anew), and last.ckpt goes unless it is of this update.  best.ckpt stays.
  /// Throws std::filesystem::filesystem_error.
  void remove_surplus(std::uint64_t update, int keep, bool is_last) const;

 private:
  std::filesystem::path out_;
};

/// The folder of the run whose checkpoint this is: checkpoints/ is left out.
std::filesystem::path run_folder_of(const std::filesystem::path& checkpoint);

}  // namespace earshot
