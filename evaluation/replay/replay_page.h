// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "evaluation/replay/episode_recording.h"

namespace earshot {

/// Texts of a page besides the recording.
struct ReplayCaption {
  std::string agent, set_hash, engine_hash;
  std::string policy;  ///< file whose values are shown; empty: none
  /// Another page, by its address and what the link says: the table that the agent stands in, other episodes.
  std::vector<std::pair<std::string, std::string>> links = {};
};

/// The recording as JSON, its pictures, sound and geometry in base64 (docs/howto/replay.md), as the page reads it.
std::string replay_json(const EpisodeRecording& recording, const ReplayCaption& caption);
/// One HTML file that plays the recording in a browser, without a network: the house in three dimensions, a map, camera images and sound.
std::string replay_html(const EpisodeRecording& recording, const ReplayCaption& caption);
/// Whether this build holds three.js; without, pages show the map in place of the house.
bool replay_has_three();

}  // namespace earshot
