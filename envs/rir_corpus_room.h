#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <memory>
#include <string>
#include <vector>

#include "envs/rir_corpus_config.h"
#include "sim/acoustics/core/sound_source.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/audio/listener_orientation.h"
#include "sim/nav/navmesh.h"

namespace earshot {

/// A room of a corpus before it is loaded.
struct CorpusRoomSpec {
  std::string scene;                 ///< any SCENE
  std::uint64_t materials_seed = 0;  ///< of config.randomize
};

/// All rooms: shoeboxes first, then every scene rooms_per_scene times.  Room i is a function of (config, i); shoeboxes do not depend on how
/// many there are.  Throws InputError: a folder without scenes, a damaged range.
std::vector<CorpusRoomSpec> list_corpus_rooms(const RirCorpusConfig& config);

struct CorpusSource {
  SoundSource sound;  ///< at a place in the coordinates of the engine
  std::string pattern;
  double heading_deg = 0;
};

struct CorpusListener {
  glm::vec3 position{0};  ///< in the coordinates of the engine
  double heading_deg = 0, pitch_deg = 0, roll_deg = 0;
  [[nodiscard]] ListenerOrientation orientation() const;
};

/// A loaded room, with what draws places in it.  Immutable, safe from any thread.
class CorpusRoom {
 public:
  /// Throws InputError as load_scene, and where nothing is walkable.
  CorpusRoom(const RirCorpusConfig& config, std::size_t index, const CorpusRoomSpec& spec);

  [[nodiscard]] const AcousticScene& acoustics() const { return acoustics_; }
  [[nodiscard]] const Scene& scene() const { return acoustics_.scene(); }
  /// Source number `source`: a function of (config, room, source).  Throws InputError if no place is free in a thousand.
  [[nodiscard]] CorpusSource draw_source(int source) const;
  /// Listener number `listener` of that source.
  [[nodiscard]] CorpusListener draw_listener(const CorpusSource& from, int source, int listener) const;

 private:
  [[nodiscard]] bool is_free(glm::vec3 foot, float height_m) const;

  const RirCorpusConfig& config_;
  std::uint32_t index_;
  AcousticScene acoustics_;
  Navmesh navmesh_;
};

}  // namespace earshot
