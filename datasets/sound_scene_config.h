// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "datasets/rir_corpus_config.h"

namespace earshot {

/// Sounds of one class: files, folders, or synth:KIND, whose instances are drawn.
struct SoundClass {
  std::string name;
  std::vector<std::string> sounds;
};

/// Recordings of sound scenes with labels of classes and directions: events of several classes at places of a room, at rest or on the
/// move.  A plain value.
struct SoundSceneConfig {
  /// Rooms, places, channels and acoustics, with the keys of a corpus of responses; those of sources and listeners have no effect.
  RirCorpusConfig rooms;
  int recordings_per_room = 4;
  float duration_s = 10;
  std::vector<SoundClass> classes;      ///< their order is their index
  std::vector<int> events = {2, 6};     ///< least and most of a recording, before `max_overlap` leaves some out
  std::vector<float> event_s = {1, 4};  ///< length; a sound loops
  int max_overlap = 2;                  ///< events that sound at once, at most
  float moving = 0.5f;                  ///< fraction of events whose source walks
  std::vector<float> speed_m_per_s = {0.3f, 1.5f};
  std::vector<float> event_db = {-6, 6};  ///< of the dry sound of an event, its root mean square over that of others
  std::string noise;                      ///< as dataset convolve: empty, synth, or a folder; unrelated between channels
  std::vector<float> snr_db = {10, 30};   ///< all events over the noise, over all channels and the whole recording
  std::vector<float> level_dbfs = {-35, -25};
  bool skip_bad = false;  ///< leave out sound files that are bad (corpus_inputs.h); else refuse them
};

/// Reads the keys above beside those of the rooms.  Throws InputError.
void read(ConfigReader& reader, SoundSceneConfig& config);
/// Throws InputError "key = value: rule".
void validate(const SoundSceneConfig& config);
SoundSceneConfig load_sound_scene_config(const std::string& path, const std::vector<std::string>& overrides);
/// Every key with its value, a line each: the same recordings.
std::string config_text(const SoundSceneConfig& config);

}  // namespace earshot
