// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "datasets/sound_scene_corpus.h"
#include "tests/support/envs/rir_corpus_cases.h"

namespace earshot::corpus_cases {

/// Rooms whose walls take nearly all, so that direct sound is nearly all there is.
inline SoundSceneConfig dry_scenes() {
  SoundSceneConfig config;
  config.rooms = corpus_cases::tiny();
  config.rooms.shoeboxes.count = 2;
  config.rooms.shoeboxes.min_size_m = {5, 3, 5};
  config.rooms.shoeboxes.max_size_m = {6, 3, 6};
  config.rooms.shoeboxes.absorption = {0.999f, 1.f};
  config.rooms.source_height_m = {0.4f, 2.2f};
  config.rooms.channels = "ambisonic:1:sn3d:ego";
  config.rooms.pitch_deg = {-20, 20};
  config.recordings_per_room = 3;
  config.duration_s = 4;
  config.classes = {{"noise", {"synth:noise"}}, {"engine", {"synth:engine"}}};
  config.events = {2, 4};
  config.event_s = {0.8f, 1.5f};
  config.speed_m_per_s = {0.8f, 1.5f};
  return config;
}

}  // namespace earshot::corpus_cases
