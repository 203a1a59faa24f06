// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "datasets/response_index.h"

namespace earshot {

/// Measured responses as those of a corpus: signals are made of them alike.
struct MeasuredIndex {
  float sample_rate_hz = 0;
  std::vector<std::string> channels;  ///< "0", "1" and so on
  std::vector<IndexedResponse> responses;
  std::uint64_t hash = 0;  ///< of names, places and samples
};

/// Every sound file of a folder and of those below it, in the order of their names.  With a places file (measured_room.h) in the folder
/// only the files that it names: they are one room, and have sources, places and distances.  Without it the folder of a file is its room,
/// each file is a source at a place of its own, and distances are 1 m.  Gains bring the direct sound (2.5 ms about the onset) of the first
/// channel to that of a unit source at the distance, 1 / (4 pi r); t20_mid_s and drr_db are measured there (noise_tail.h).  Throws
/// InputError: no sound files, SOFA files, a file that is unreadable, silent, or of another number of channels or sample rate than those
/// before it, and places as load_measured_room does, or with a channel, as whole files are played.
MeasuredIndex index_measured(const std::filesystem::path& folder);

}  // namespace earshot
