// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "bench/accuracy/shoebox_images.h"

namespace earshot {

/// An acoustic engine that is not ours: `--engine NAME=COMMAND`.
struct EngineCommand {
  std::string name, command;
  bool optional = false;  ///< left out, with a line, where it fails
  /// Throws InputError unless both sides of the first `=` are there, or for a name that tables cannot hold.
  static EngineCommand parse(const std::string& text);
};

/// Result of an engine for one room.
struct EngineAnswer {
  bool available = true;      ///< false: a dependency is not installed; `note` names it
  std::string setting, note;  ///< in its own words
  double seconds_per_response = 0;
  std::vector<std::vector<float>> responses;  ///< by listener, at the room's rate
};

/// Exit code of an engine for a missing dependency (sysexits.h, EX_UNAVAILABLE).
inline constexpr int kEngineUnavailable = 69;

/// A word of /bin/sh.
std::string shell_quoted(const std::string& text);

/// Runs `COMMAND REQUEST` with a room in a JSON file and reads what it wrote beside it, as documented in docs/evidence/accuracy.md. folder:
/// must exist; files of that name are overwritten.  Processes that the command started end with it.  Throws InputError, one line that names
/// the
/// engine: it fails (unless it is optional), takes longer than timeout_s, or a file is missing or wrong.
EngineAnswer ask_engine(const EngineCommand& engine, const ShoeboxRoom& room, double seconds_per_response,
                        const std::filesystem::path& folder, double timeout_s = 300);

}  // namespace earshot
