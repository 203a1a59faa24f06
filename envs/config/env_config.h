// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "envs/sensors/observation.h"
#include "envs/task/av_nav_task.h"
#include "sim/acoustics/core/acoustic_config.h"
#include "sim/base/text/config_reader.h"
#include "sim/nav/navmesh.h"

namespace earshot {

class SceneCache;

/// How envs draw episodes: at random without end, or each episode of the set exactly once (env e of n takes e, e + n, ...).
enum class EpisodeOrder { random, once };

/// Behaviour of an env after the end of an episode.
enum class Autoreset {
  same_step,  ///< the step that ends it begins the next one: its row of observations is the first of the new episode
  next_step,  ///< the next step begins the next one and ignores the action: reward 0, no flags
  off,        ///< nothing; the env takes no step until BatchedEnv::reset() with its flag
};

/// The environments of a run: task, sensors, acoustics and where files are.  A plain value; needs none of the engine's headers.
struct EnvConfig {
  TaskConfig task;
  ObservationSpec observation;
  AcousticConfig acoustics;
  /// "t20=10%,drr=2dB" (AccuracyTarget): required accuracy of the acoustics; replaces their rays, images and fields.  Empty:
  /// acoustics decides.  Environments take a config in which plan_env_accuracy (env_accuracy.h) has replaced it by its choice.
  std::string accuracy;
  NavmeshConfig navmesh;
  std::string hrtf;        ///< SOFA file; empty: rigid sphere
  std::string sound_root;  ///< folder of sounds that are named without a path ("my_ring", of original sets)
  float sound_gain = 1.f;  ///< applied to the dry sound; the spectrogram is log(1 + x), so the scale matters
  float crossfade_s = 0.05f;
  /// Each step begins the sounds anew, without what rings of the steps before, as environments do that render every step by itself; for
  /// comparison.
  bool sound_restarts = false;
  int agents = 1;  ///< in each env: the first ones of its episode, which must have as many
  EpisodeOrder order = EpisodeOrder::random;
  Autoreset autoreset = Autoreset::same_step;
  int threads = 1;  ///< over the batch; 0: all cores
  /// A stage of one env that takes longer is given up: its episode is quarantined, the env leaves the batch until the stage returns, and
  /// the others go on.  0: none is given up.  With a limit, threads of the batch do all the work and the caller waits.
  double stage_limit_s = 0;
  std::uint64_t seed = 0;
  std::string scene_root;  ///< folder of relative scene files
  double scene_cache_gb = 4;
  bool prefetch = true;  ///< load the scene and source of an env's next episode in the background
  /// Folder of source fields (acoustics.field) that all environments, workers and runs share; made when it is needed.  Empty: in memory
  /// only.
  std::string field_store;
  double field_store_gb = 20;  ///< in that folder; the least recently used go first
  /// Folder of preprocessed scenes (scene_store.h) that all environments, workers and runs share; made when it is needed.  Empty: scenes
  /// are loaded and preprocessed by each process.
  std::string scene_store;
  double scene_store_gb = 20;  ///< in that folder; the least recently used go first
  /// Folder for files of quarantined episodes, which `earshot replay` runs again; made when it is needed.  Empty: counted and logged only.
  std::string quarantine_dir;
};
/// Reads the sections task, acoustics, observation and navmesh and the keys above; a missing key keeps its value.  The analysed window
/// (observation.sound) follows acoustics.sample_rate_hz.  Throws InputError: wrong type, unknown key of a section, unknown preset.
void read(ConfigReader& reader, EnvConfig& config);
/// Throws InputError naming key, value and rule.
void validate(const EnvConfig& config);
/// Every key with its value, as YAML that read() takes: the same environments.
std::string config_text(const EnvConfig& config);

/// A scene cache with the acoustics, folders and bounds of this configuration.
std::shared_ptr<SceneCache> make_scene_cache(const EnvConfig& config);

}  // namespace earshot
