// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "envs/task/episode.h"

namespace earshot {

/// Why an episode was taken out of a run.  Append only: files hold the names.
enum class Fault : std::uint8_t {
  scene,        ///< its scene, source or start is unavailable: the file is missing or damaged, nothing is walkable
  path,         ///< no walkable path leads from its start to its goal
  distance,     ///< on the way, the distance to the goal was not finite or was not available
  reward,       ///< not finite, as all that follow
  pose,         //
  depth,        //
  rir,          //
  sound,        ///< the sound at the ears
  spectrogram,  //
  pointgoal,    //
  stage,        ///< a stage of the step threw an exception
  stall,        ///< a stage took longer than EnvConfig::stage_limit_s
};
inline constexpr std::size_t kNumFaults = 12;
std::string_view name_of(Fault fault);
std::optional<Fault> fault_by_name(std::string_view name);

struct FaultReport {
  Fault fault = Fault::scene;
  std::string detail;  ///< one line
};

/// Output of a stage of the environment, before it is checked.
struct StageOutput {
  Fault kind;  ///< the fault it would be: distance, reward, pose (x, y, z, heading), depth, rir, sound, spectrogram or pointgoal
  int env;     ///< global env id
  std::uint64_t episode_index;
  int step;       ///< of the episode; 0: its first observation
  int agent = 0;  ///< of the env
};
/// An observer of stage outputs that may change them: monitors, and tests that inject faults.  Called from worker threads, and for
/// pictures by EGL from the thread that steps.
using StageHook = std::function<void(const StageOutput& output, std::span<float> values)>;

/// Episodes that were quarantined, by reason, since construction.
struct QuarantineCounters {
  std::array<std::uint64_t, kNumFaults> episodes{};
  std::uint64_t files_written = 0;
  std::uint64_t files_failed = 0;    ///< could not be written
  std::uint64_t files_left_out = 0;  ///< of the same fault of the same episode, or past the bound on files
  [[nodiscard]] std::uint64_t of(Fault fault) const { return episodes[static_cast<std::size_t>(fault)]; }
  [[nodiscard]] std::uint64_t total() const;
  /// Of those: where a number was not finite.
  [[nodiscard]] std::uint64_t nonfinite() const;
};

/// A quarantined episode with all that is needed to run it again.
struct QuarantineRecord {
  FaultReport report;
  std::string engine;  ///< commit of the build
  std::uint64_t set_hash = 0, seed = 0, episode_index = 0;
  int env = 0, episode_count = 0;    ///< global env id, and the number of its earlier episodes: both decide where the sound begins
  int step = 0;                      ///< at which the fault was found; 0: before the agent could act
  std::vector<std::int8_t> actions;  ///< of the first agent
  Episode episode;
  std::string config;                                 ///< EnvConfig as YAML, every key
  std::vector<std::vector<std::int8_t>> others = {};  ///< actions of the further agents, as far as each came
};
/// JSON with a version.
std::string encode(const QuarantineRecord& record);
/// Throws InputError that names `where`: not JSON, another version, missing or wrong fields.
QuarantineRecord decode_quarantine_record(std::string_view text, const std::string& where);
QuarantineRecord load_quarantine_record(const std::filesystem::path& path);

/// The faulty episodes of one batch: counted, logged (the first of a reason, then each time their number has doubled) and, if
/// there is a folder, written to a file each.  Thread-safe.
class Quarantine {
 public:
  /// Bounds the disk space of a long run.
  static constexpr std::uint64_t kMaxFiles = 1000;

  /// folder: made when it is needed; empty: no files.  max_files: of this batch.
  explicit Quarantine(std::filesystem::path folder, std::uint64_t max_files = kMaxFiles);
  ~Quarantine();
  /// Does not throw for a file that cannot be written: a folder that is full or read-only is logged once and counted.
  void add(const QuarantineRecord& record);
  [[nodiscard]] QuarantineCounters counters() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace earshot
