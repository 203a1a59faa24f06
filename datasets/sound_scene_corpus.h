// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

#include "datasets/corpus_parts.h"
#include "datasets/sound_scene_config.h"

namespace earshot {

struct SoundSceneReport {
  std::uint64_t recordings = 0, all_recordings = 0;  ///< written by this run; of the whole
  std::size_t folders_missing = 0;
  std::size_t left_out = 0;  ///< sound files, with skip_bad
};

/// Writes recordings of sound scenes with DCASE's labels, or completes what was begun (docs/howto/datasets_signals.md); every byte is a
/// function of (config, sounds, program).
///
///   OUT/00000/000007_r0003.wav   recording 3 of room 7
///   OUT/00000/000007_r0003.csv   its labels (dcase_metadata)
///   OUT/classes.txt              names of the classes by index
///   OUT/manifest.jsonl, recordings.jsonl, supervisions.jsonl
///
/// Throws InputError, RunError.
SoundSceneReport write_sound_scenes(const SoundSceneConfig& config, const CorpusRun& run);

}  // namespace earshot
