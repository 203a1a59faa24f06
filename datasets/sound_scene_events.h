// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

#include "datasets/rir_corpus_room.h"
#include "datasets/sound_scene_config.h"

namespace earshot {

/// A point of a walk, in the coordinates of the engine.
struct WalkPoint {
  double t_s = 0;  ///< from the onset
  glm::vec3 position{0};
};

/// One event of a recording.
struct SoundEvent {
  std::size_t class_index = 0;
  int number = 0;     ///< of the source within the recording
  std::string sound;  ///< for open_sound
  double onset_s = 0, offset_s = 0, speed_m_per_s = 0, level_db = 0;
  std::vector<WalkPoint> path;  ///< one point: at rest
  [[nodiscard]] bool moves() const { return path.size() > 1; }
  /// Where the source is so long after the onset: on straight lines between the points.
  [[nodiscard]] glm::vec3 position_at(double since_onset_s) const;
};

/// Sounds, their places and the listener of a recording.
struct SoundScenePlan {
  CorpusListener listener;
  std::vector<SoundEvent> events;  ///< by onset
};

/// Sounds of every class, folders expanded: [class][sound].
using ClassSounds = std::vector<std::vector<std::string>>;
ClassSounds expand_classes(const SoundSceneConfig& config);

/// Recording `recording` of a room: a function of (config, room, recording).  Events that would sound with more than max_overlap - 1
/// others wherever they began in a hundred draws are left out.  Throws InputError where no place is free.
SoundScenePlan plan_sound_scene(const SoundSceneConfig& config, const ClassSounds& sounds, const CorpusRoom& room, std::size_t room_index,
                                int recording);

/// The labels as DCASE 2024 and STARSS23 have them (task 3: sound event localization and detection with distance): a line for each frame of
/// 100 ms and event that sounds at its centre, "frame,class,source,azimuth,elevation,distance": degrees, counter-clockwise from the
/// front of the listener and up, centimetres.
std::string dcase_metadata(const SoundScenePlan& plan, float duration_s);

}  // namespace earshot
