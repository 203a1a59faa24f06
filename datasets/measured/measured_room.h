// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <glm/gtc/quaternion.hpp>
#include <glm/vec3.hpp>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "sim/audio/head/directivity.h"
#include "sim/base/text/config_key.h"

namespace earshot {

/// A measured response and where it was measured.
struct MeasuredResponse {
  std::string name;                       ///< for people: file, and channel or number in it
  glm::dvec3 source_m{0}, listener_m{0};  ///< in world coordinates of the scene
  glm::quat source_orientation{1, 0, 0, 0};
  std::optional<double> direct_delay_s;  ///< of the direct sound in the record; nullopt: its onset counts (onset.h)
  std::vector<float> samples;            ///< any scale, finite
};

/// The responses of one room.
struct MeasuredRoom {
  std::string scene;                                  ///< SCENE that the places file names, as a path from here; empty if none
  std::shared_ptr<const Directivity> source_pattern;  ///< null: omnidirectional
  float sample_rate_hz = 0;
  std::vector<MeasuredResponse> responses;
};

/// Reads a room.
///  - A folder of sound files: `places` names a YAML or JSON file, by default places.yaml, places.yml or places.json in the folder:
///      scene: room.yaml                 # SCENE, relative to this file; optional
///      up: y                            # axis of the positions that points up: y (default) or z; z as for meshes: (x, z, -y)
///      source_pattern: omni             # as --source-pattern; a file relative to this one
///      responses:
///        - {file: a.wav, channel: 0, source: [1, 1.5, 2], listener: [3, 1.2, 4], source_heading_deg: 0, source_pitch_deg: 0,
///           direct_delay_s: 0.01}       # file relative to the folder; the last five have defaults
///  - A SOFA file (SingleRoomSRIR, SingleRoomDRIR), or a folder of them: axes as in room_responses.h; places must be empty.
/// Throws InputError: no such folder, no places, unknown or mistyped keys, a file that is missing, unreadable, silent or of another sample
/// rate, a channel that it lacks, a time outside of the record, the same file and channel twice.
MeasuredRoom load_measured_room(const std::filesystem::path& measured, const std::filesystem::path& places = {});

/// Whether the folder has a places file.
bool has_places(const std::filesystem::path& measured);

/// All keys of a places file.
std::vector<ConfigKey> places_keys();

}  // namespace earshot
