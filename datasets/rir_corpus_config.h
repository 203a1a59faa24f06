// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "sim/acoustics/core/acoustic_config.h"
#include "sim/audio/dry_sounds/sound_file.h"
#include "sim/audio/head/listener_layout.h"
#include "sim/base/text/config_reader.h"
#include "sim/scene/acoustic_randomization.h"

namespace earshot {

/// Empty rooms of random size and absorption.
struct ShoeboxRooms {
  int count = 0;
  std::vector<float> min_size_m = {3, 2.4f, 3}, max_size_m = {10, 4, 8};  ///< x, y (height), z; to the centimetre
  std::vector<float> absorption = {0.05f, 0.5f};  ///< least and largest; the logarithm is uniform, one value for each wall
  /// Names of materials, one of them for each surface in place of an absorption.  Empty: absorption decides.
  std::vector<std::string> walls, floor, ceiling;
};

/// Panoramas from where the listeners stand, ahead in the middle.
struct CorpusPanorama {
  int width_px = 1152, height_px = 384;  ///< 360 degrees over the width
  /// 0: one picture, square in angle.  Otherwise so many pinhole pictures side by side, each 360 / views degrees wide, from left to right
  /// clockwise; the listener's heading is in the middle of the strip.
  int views = 0;
};

/// A corpus of room impulse responses: rooms, sources in each, listeners of each source.  A plain value.
struct RirCorpusConfig {
  std::uint64_t seed = 0;
  ShoeboxRooms shoeboxes;
  std::vector<std::string> scenes;  ///< SCENEs (house:0..99 stands for a hundred), or folders of meshes and scene YAMLs
  int rooms_per_scene = 1;          ///< so often each scene comes; with `randomize` with other materials each time
  /// Materials of every room drawn anew (acoustic_randomization.h, its seed apart); none: as the scene says.
  std::optional<AcousticRandomization> randomize;

  int sources_per_room = 4, listeners_per_source = 25;
  bool shared_listeners = false;  ///< the listeners of a room are the same for all of its sources: as mixtures need
  std::vector<float> source_height_m = {1.1f, 1.8f}, listener_height_m = {1.1f, 1.8f};  ///< least and largest, above the floor
  float clearance_m = 0.3f;                                                             ///< from walls, furniture and the ceiling
  float min_distance_m = 0.5f, max_distance_m = 1000.f;                                 ///< source to listener
  float max_height_difference_m = 1000.f;                                               ///< source to listener, along y
  std::vector<std::string> source_patterns = {"omni"};                                  ///< one of them for each source; it faces anywhere
  std::vector<float> pitch_deg = {0, 0}, roll_deg = {0, 0};                             ///< of listeners; headings are anywhere

  /// Least and largest reverberation time (t20_mid_s) and direct-to-reverberant ratio (drr_db), drawn so that each tenth comes equally
  /// often (inputs/wished_rooms.h); {0, 0}: as rooms and places give them.
  std::vector<float> rt60_s = {0, 0}, drr_db = {0, 0};

  std::string channels = "binaural", hrtf;  ///< as `earshot rir`
  std::vector<std::string> hrtfs;           ///< SOFA files, or `sphere`, one of them for each listener; empty: hrtf for all
  AcousticConfig acoustics;                 ///< key `preset` besides; its threads are those of the command
  SoundFormat format = SoundFormat::wav;
  bool sofa = false;  ///< one SOFA file (SingleRoomSRIR) per source in place of sound files
  /// Above 0: the part up to so long after the direct sound, and the rest, as files of their own that add up to the whole.
  float split_ms = 0;
  bool stated_errors = false;              ///< the standard error of t20_s beside it in the manifest (standard_errors.h)
  std::optional<CorpusPanorama> panorama;  ///< PNG files of colour, depth and category beside each response
  int rooms_per_folder = 10;

  RirCorpusConfig() { acoustics.rir_length_s = 1.f; }
};

/// Whether a range of rt60_s or drr_db is asked for.
inline bool is_range(const std::vector<float>& range) { return range[0] < range[1]; }

/// Reads the keys above over `config`; a missing key keeps its value.  Throws InputError.
void read(ConfigReader& reader, RirCorpusConfig& config);
/// Throws InputError "key = value: rule".
void validate(const RirCorpusConfig& config);
/// A file with overrides "key=value", read and validated.
RirCorpusConfig load_rir_corpus_config(const std::string& path, const std::vector<std::string>& overrides);
/// Every key with its value, as YAML that read() takes: the same corpus.
std::string config_text(const RirCorpusConfig& config);

}  // namespace earshot
