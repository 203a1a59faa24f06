// SPDX-License-Identifier: Apache-2.0
#include "evaluation/leaderboard/board_entry.h"

#include <fmt/format.h>

#include <algorithm>

#include "envs/baselines/baselines.h"
#include "envs/config/channel_order.h"
#include "evaluation/leaderboard/tracks.h"
#include "sim/base/errors.h"
#include "trainer/run/effective_config.h"

namespace earshot {
namespace {

std::string named(const Benchmark& benchmark) { return fmt::format("{} {}", benchmark.name, benchmark.version); }

const std::string kOtherTrack = fmt::format("leave the sensor out, or add --track {}, which is shown apart from the ranking", kAnything);

/// Sensors with the settings of the benchmark, as far as it has them.
ObservationSpec with_sensors_of(ObservationSpec spec, const ObservationSpec& read) {
  spec.depth = read.depth;
  spec.rgb = read.rgb;
  spec.semantic = read.semantic;
  spec.normals = read.normals;
  spec.spectrogram = read.spectrogram;
  spec.interaural = read.interaural;
  spec.waveform = read.waveform;
  spec.heard = read.heard;
  spec.pointgoal = read.pointgoal;
  spec.gps_compass = read.gps_compass;
  spec.pose = read.pose;
  spec.collision = read.collision;
  spec.previous_action = read.previous_action;
  spec.topdown_map = read.topdown_map;
  spec.oracle_action = read.oracle_action;
  spec.goal_state = read.goal_state;
  // A setting that has no effect without a sensor is refused.
  if (!spec.spectrogram) spec.legacy_spectrogram = false;
  if (!spec.gps_compass && !spec.pose) spec.pose_noise = {};
  if (!spec.topdown_map) spec.map = {};
  if (!spec.rgb) spec.unlit = false;
  for (ExtraCamera& camera : spec.cameras) {
    const auto existing = std::ranges::find(read.cameras, camera.name, &ExtraCamera::name);
    const bool has = existing != read.cameras.end();
    camera.depth = has && existing->depth;
    camera.rgb = has && existing->rgb;
    camera.semantic = has && existing->semantic;
    camera.normals = has && existing->normals;
    if (!camera.rgb) camera.config.unlit = false;
  }
  std::erase_if(spec.cameras, [](const ExtraCamera& camera) { return !(camera.depth || camera.rgb || camera.semantic || camera.normals); });
  const auto cameras = spec.all_cameras();
  if (std::ranges::none_of(cameras, &ExtraCamera::depth)) spec.depth_noise = false;
  const auto is_pinhole = [](const ExtraCamera& camera) { return camera.config.projection == Projection::pinhole; };
  if (std::ranges::none_of(cameras, is_pinhole)) {
    spec.renderer = Renderer::embree;
    spec.egl_device = "auto";
  }
  return spec;
}

/// Its rate makes the window that is analysed, so that it is a setting of every sensor of the ears.
void refuse_other_rate(const Benchmark& benchmark, const EnvConfig& ours, const EnvConfig& theirs, const std::string& where) {
  if (!theirs.observation.hears() || ours.acoustics.sample_rate_hz == theirs.acoustics.sample_rate_hz) return;
  throw InputError(where,
                   fmt::format("reads the ears with env.acoustics.sample_rate_hz = {}, but {} has {}", theirs.acoustics.sample_rate_hz,
                               named(benchmark), ours.acoustics.sample_rate_hz),
                   "train it with the sensors of the benchmark");
}

/// Sensors of a baseline in the env of the benchmark.
std::vector<SensorSpec> read_by(Baseline baseline, const ObservationSpec& spec) {
  ObservationSpec all = spec;
  all.heard = all.waveform = all.depth = all.collision = true;
  const auto kinds = sensors_of(baseline);
  std::vector<SensorSpec> read;
  for (const SensorSpec& sensor : sensor_table(all, 1))
    if (sensor.camera <= 0 && std::ranges::count(kinds, sensor.kind) > 0) read.push_back(sensor);
  return read;
}

/// The benchmark's env for a policy outside the tracks.  Its ears may be of another kind: they have no head, or need more harmonics of the
/// late sound.
EnvConfig with_sensors_outside_tracks(const EnvConfig& ours, const ObservationSpec& theirs) {
  EnvConfig env = ours;
  env.observation = theirs;
  env.observation.renderer = ours.observation.renderer;
  env.observation.egl_device = ours.observation.egl_device;
  if (!theirs.has_ears()) env.hrtf.clear();
  raise_order_to_channels(env);
  return env;
}

/// Throws InputError with the first key outside the sensors that differs.
void refuse_other_world(const EvaluationResult& result, const std::string& where, const Benchmark& benchmark, const SensedConfig& ours) {
  for (const ConfigChange& change : config_changes(ours, result.senses)) {
    if (is_sensor_key(change.key) && result.baseline.empty()) continue;
    if (change.key == "acoustics.field" && ours.at(change.key) == "auto") continue;
    throw InputError(where, fmt::format("was run with env.{} = {}, but {} has {}", change.key, change.now, named(benchmark), change.before),
                     "evaluate the agent again with --benchmark");
  }
}

/// Whole or not.
Standing standing_by_senses(const EvaluationResult& result, const std::string& where, const Benchmark& benchmark) {
  if (!result.track.empty() && result.track != kAnything)
    throw InputError(where, fmt::format("asks for the track '{}'", result.track), "evaluate the agent again with --benchmark");
  if (result.senses.empty())
    return {.track = kAnything, .rests_on = {}, .apart = "its result does not say what it sensed: an older version wrote it"};
  const SensedConfig ours = sensed_config(benchmark.run.env);
  const bool is_outside_tracks = result.track == kAnything && result.baseline.empty();
  refuse_other_world(result, where, benchmark,
                     is_outside_tracks
                         ? sensed_config(with_sensors_outside_tracks(benchmark.run.env, env_of_senses(result.senses, where).observation))
                         : ours);
  if (!result.baseline.empty()) {
    const auto baseline = baseline_by_name(result.baseline);
    if (!baseline)
      throw InputError(where, fmt::format("names a baseline '{}' that there is not", result.baseline), "use one of: " + baseline_names());
    if (reads_simulator(*baseline)) return {.track = kAnything, .rests_on = {}, .apart = "it reads the goal and the map of the simulator"};
    const auto read = read_by(*baseline, benchmark.run.env.observation);
    if (const Track* track = track_of(benchmark.tracks, read)) return {.track = track->name, .rests_on = {}, .apart = {}};
    return {.track = kAnything, .rests_on = {}, .apart = "it " + no_track_reason(benchmark.tracks, read)};
  }
  const EnvConfig theirs = env_of_senses(result.senses, where);
  const std::vector<SensorSpec> read = sensor_table(theirs.observation, 1);
  const auto changed = changed_settings(ours, result.senses, read);
  const Track* track = track_of(benchmark.tracks, read);
  if (track != nullptr && changed.empty() && result.track.empty()) return {.track = track->name, .rests_on = {}, .apart = {}};
  std::string why = track == nullptr  ? no_track_reason(benchmark.tracks, read)
                    : changed.empty() ? fmt::format("asked for the track '{}'", kAnything)
                                      : fmt::format("reads sensors with {} = {}, but {} has {}", changed[0].key, changed[0].theirs,
                                                    named(benchmark), changed[0].ours);
  if (result.track != kAnything) throw InputError(where, fmt::format("{}: {} refuses it", why, named(benchmark)), kOtherTrack);
  return {.track = kAnything, .rests_on = {}, .apart = "it " + why};
}

}  // namespace

EnvConfig env_for_policy(const Benchmark& benchmark, const EnvConfig& benchmark_env, const EnvConfig& policy_env, const std::string& where,
                         bool anything) {
  EnvConfig env = benchmark_env;
  const std::vector<SensorSpec> read = sensor_table(policy_env.observation, 1);
  refuse_other_rate(benchmark, benchmark_env, policy_env, where);
  if (anything) {
    env = with_sensors_outside_tracks(benchmark_env, policy_env.observation);
    validate(env);
    return env;
  }
  if (track_of(benchmark.tracks, read) == nullptr)
    throw InputError(where, fmt::format("{}: {} refuses it", no_track_reason(benchmark.tracks, read), named(benchmark)), kOtherTrack);
  EnvConfig theirs = policy_env;
  theirs.hrtf = benchmark_env.hrtf;  // the head is the benchmark's, and a path of others is not read
  const auto changed = changed_settings(sensed_config(benchmark_env), sensed_config(theirs), read);
  if (!changed.empty())
    throw InputError(
        where,
        fmt::format("reads sensors with {} = {}, but {} has {}", changed[0].key, changed[0].theirs, named(benchmark), changed[0].ours),
        "train it with the sensors of the benchmark");
  env.observation = with_sensors_of(benchmark_env.observation, policy_env.observation);
  validate(env);
  return env;
}

std::vector<std::string> changed_in_training(const EnvConfig& benchmark_env, const EnvConfig& policy_env) {
  std::vector<std::string> keys;
  const auto differs = [](const std::string& key) {
    return !is_sensor_key(key) && key != "seed" && key != "acoustics.field" && !key.ends_with("_reward") && key != "stage_limit_s";
  };
  EnvConfig policy = policy_env;
  policy.hrtf.clear();  // a path of others is not read
  EnvConfig ours = benchmark_env;
  ours.hrtf.clear();
  for (const ConfigChange& change : config_changes(sensed_config(ours), sensed_config(policy)))
    if (differs(change.key)) keys.push_back(change.key);
  if (policy_env.hrtf.empty() != benchmark_env.hrtf.empty()) keys.emplace_back("hrtf");
  return keys;
}

Standing standing_of(const EvaluationResult& result, const std::string& where, const Benchmark& benchmark) {
  Standing standing = standing_by_senses(result, where, benchmark);
  if (!result.partial_of.empty() && standing.apart.empty()) standing.apart = "it covers only the first episodes of the set";
  return standing;
}

void note_evidence(Standing& standing, Evidence evidence) {
  switch (evidence) {
    case Evidence::actions:
      standing.rests_on = "actions alone";
      if (standing.apart.empty()) standing.apart = "its policy was not run by the board: nothing shows what chose its actions";
      return;
    case Evidence::run_by_board:
      standing.rests_on = "run by the board";
      return;
    case Evidence::private_set:
      standing.rests_on = "run by the board, on the private set too";
      return;
  }
}

}  // namespace earshot
