// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "evaluation/replay/episode_recording.h"

namespace earshot {

/// The recording as an MCAP file (version 0), which robotics tools play: topics /agent (foxglove.PoseInFrame; frame "scene", y up), /camera
/// (foxglove.CompressedImage), /sound (foxglove.RawAudio, both ears) and /step (earshot.Step: action, reward, distances, bearing, levels,
/// value), one message of each for every observation, all JSON with a schema.  Times are those of the episode, from 0.  Without chunks and
/// index: an episode is small.
std::string replay_mcap(const EpisodeRecording& recording);

}  // namespace earshot
