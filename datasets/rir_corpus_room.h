// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <glm/vec3.hpp>
#include <memory>
#include <string>
#include <vector>

#include "datasets/rir_corpus_config.h"
#include "datasets/rir_corpus_pictures.h"
#include "sim/acoustics/core/sound_source.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/audio/head/listener_orientation.h"
#include "sim/base/random.h"
#include "sim/nav/navmesh.h"

namespace earshot {

/// A room of a corpus before it is loaded.
struct CorpusRoomSpec {
  std::string scene;                 ///< any SCENE
  std::uint64_t materials_seed = 0;  ///< of config.randomize
  bool is_first_of_scene = true;     ///< of several rooms of one scene the one that says what is odd about it
};

/// Scenes as a config lists them: ranges of names (name_ranges.h) and folders become the scenes in them, by order of names.  Throws
/// InputError: a folder without scenes, a damaged range, a name that is not UTF-8.
std::vector<std::string> expand_scenes(const std::vector<std::string>& scenes);

/// All rooms: shoeboxes first, then every scene rooms_per_scene times.  Room i is a function of (config, i); shoeboxes do not depend on how
/// many there are.  Throws InputError: a folder without scenes, a damaged range.
std::vector<CorpusRoomSpec> list_corpus_rooms(const RirCorpusConfig& config);

/// The same room drawn again, number `redraw` from 1 on: a shoebox with another shape, a scene with other random materials.
CorpusRoomSpec redraw_room(const RirCorpusConfig& config, std::size_t index, const CorpusRoomSpec& spec, std::uint32_t redraw);

struct CorpusSource {
  SoundSource sound;  ///< at a place in the coordinates of the engine
  std::string pattern;
  double heading_deg = 0;
};

struct CorpusListener {
  glm::vec3 position{0};  ///< in the coordinates of the engine
  double heading_deg = 0, pitch_deg = 0, roll_deg = 0;
  std::size_t head = 0;  ///< of config.hrtfs
  [[nodiscard]] ListenerOrientation orientation() const;
};

/// A foot point with free air up to a height above it and beyond.
struct FreePlace {
  glm::vec3 foot{0};
  float height_m = 0;
  [[nodiscard]] glm::vec3 position() const { return foot + glm::vec3(0, height_m, 0); }
};

/// A loaded room, with what draws places in it.  Immutable, safe from any thread.
class CorpusRoom {
 public:
  /// Logs what is odd about a scene (scene_check.h).  Throws InputError as load_scene, where nothing is walkable, and with
  /// config.shared_listeners as draw_source.
  CorpusRoom(const RirCorpusConfig& config, std::size_t index, const CorpusRoomSpec& spec);

  [[nodiscard]] const AcousticScene& acoustics() const { return acoustics_; }
  [[nodiscard]] const Scene& scene() const { return acoustics_.scene(); }
  /// Source number `source`: a function of (config, room, source).  Throws InputError if no place is free in a thousand.
  [[nodiscard]] CorpusSource draw_source(int source) const;
  /// Listener number `listener` of that source; with config.shared_listeners of all sources, as far from each as the config asks.
  /// redraw: number of the place that is drawn instead of the first one, 0.
  [[nodiscard]] CorpusListener draw_listener(const CorpusSource& from, int source, int listener, std::uint32_t redraw = 0) const;
  /// A free place on the floor at a height of the range that `accept` takes: a function of the room, `random` and `number`.  Throws
  /// InputError "has no free place for WHAT" after a thousand draws.
  [[nodiscard]] FreePlace draw_place(const RandomStream& random, std::uint32_t number, const std::vector<float>& height_m,
                                     const std::function<bool(glm::vec3)>& accept, const std::string& purpose) const;
  [[nodiscard]] const Navmesh& navmesh() const { return navmesh_; }
  /// Of config.panorama; null without it.
  [[nodiscard]] const CorpusPictures* pictures() const { return pictures_.get(); }

 private:
  [[nodiscard]] bool is_free(glm::vec3 foot, float height_m) const;

  const RirCorpusConfig& config_;
  std::uint32_t index_;
  AcousticScene acoustics_;
  Navmesh navmesh_;
  std::unique_ptr<const CorpusPictures> pictures_;
  std::vector<glm::vec3> sources_;  ///< places of all, with config.shared_listeners
};

}  // namespace earshot
