// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "bench/soak/scenes.h"
#include "envs/batch/batched_env.h"

namespace earshot {

/// Data of an episode for the bound on heard energy (watch.h).
struct SoakEpisode {
  std::uint32_t scene = 0;     ///< index of its SoakScene
  double dry_mean_square = 0;  ///< largest of its dry sound over any window of one step, gain included
};

struct SoakEpisodes {
  EpisodeSet set;                     ///< scene after scene, so that envs with EpisodeOrder::once walk through the scenes together
  std::vector<SoakEpisode> episodes;  ///< one per episode of the set
  std::vector<std::string> refused;   ///< scenes in which no episode could be made, each with the reason
};

/// per_scene episodes in each scene, of the sounds of all kinds, made on `threads` threads: a function of (scenes, per_scene, seed).  Loads
/// every scene once, through `cache`.
SoakEpisodes make_soak_episodes(const std::vector<SoakScene>& scenes, int per_scene, const EnvConfig& config, SceneCache& cache,
                                int threads, std::uint64_t seed);

/// The most energy that the reverberation of a room of this volume and equivalent absorption area can hold at a listener on average, per
/// unit of source, Green units, within a response of this length: the diffuse field 1 / (pi A) (Kuttruff, Room Acoustics, eq. 5.6, with
/// direct energy 1 / (4 pi r)^2), and not more than what a room without any absorption gathers in that time, c T / (4 pi V).
double diffuse_field_energy(double volume_m3, double absorption_area_m2, double rir_length_s, double speed_m_per_s);

/// The same for the room of `source` (in the coordinates of the loaded scene): of a generated house the room of its plan (outside of all:
/// the loudest room), else the bounds of the scene.  Absorption: area times coefficient of the triangles that lie in the room, in the band
/// that absorbs least; only the sum of surfaces counts, doors do not, so the bound holds for closed doors.
double diffuse_field_energy(const SoakScene& scene, const EnvScene& loaded, glm::vec3 source);

/// Largest mean square over any `window` samples of a loop.
double largest_mean_square(std::span<const float> loop, std::size_t window);

}  // namespace earshot
