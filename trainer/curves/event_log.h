// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "trainer/curves/tensorboard_writer.h"

namespace earshot {

/// One point of the training curves.
struct CurvePoint {
  std::uint64_t update = 0, env_steps = 0;
  double wall_s = 0;                                   ///< since the run began, pauses left out
  std::vector<std::pair<std::string, double>> values;  ///< by name, in file order; NaN for a missing value (null in the file)
};

/// Whether the point is that of an evaluation on held-out episodes: a line of its own, behind that of its update.
bool is_of_held_out(const CurvePoint& point);

/// Of a resumed run that keeps every evaluation in its curve.
inline constexpr std::uint64_t kAllEvaluations = std::numeric_limits<std::uint64_t>::max();

/// The training curves of one run, in its folder: events.jsonl, one line {"update", "env_steps", "wall_s", "values": {name: number or
/// null}} per point, and the same values as TensorBoard scalars over env_steps.  Each line is one write, so a crash can tear only the last.
class EventLog {
 public:
  /// Creates the folder.  Points after `resumed_update` are of a future that a resumed run makes anew: they are cut off (0: a fresh curve);
  /// so are evaluations after `evaluated_update`.  Throws InputError if events.jsonl exists and is not an event log, RunError if it cannot
  /// be written.
  explicit EventLog(const std::filesystem::path& folder, std::uint64_t resumed_update = 0,
                    std::uint64_t evaluated_update = kAllEvaluations);
  ~EventLog();
  EventLog(const EventLog&) = delete;
  EventLog& operator=(const EventLog&) = delete;

  /// Throws RunError (disk full); the file then ends with the line before.
  void write(const CurvePoint& point);
  void write(std::uint64_t update, std::uint64_t env_steps, double wall_s, std::vector<std::pair<std::string, double>> values) {
    write({update, env_steps, wall_s, std::move(values)});
  }

 private:
  std::filesystem::path path_;
  int descriptor_ = -1;
  std::optional<TensorBoardWriter> tensorboard_;
};

/// Reads an events.jsonl.  A torn last line is left out.  Throws InputError with the line number for anything else that is not a point.
std::vector<CurvePoint> read_event_log(const std::filesystem::path& file);

}  // namespace earshot
