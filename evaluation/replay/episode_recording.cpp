// SPDX-License-Identifier: Apache-2.0
#include "evaluation/replay/episode_recording.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <limits>
#include <numeric>

#include "envs/hearing/sound_library.h"
#include "envs/task/bearing.h"
#include "evaluation/results/metric_rules.h"
#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/audio/head/interaural_bearing.h"
#include "sim/base/denormals.h"
#include "sim/base/errors.h"
#include "sim/vision/embree_camera.h"

namespace earshot {
namespace {

/// Below it a step counts as silent.
constexpr double kSilentRms = 1e-7;

/// env with the rules of the result, as one environment that does one episode.
EnvConfig recording_env(const EnvConfig& env, const EnvConfig& ruled) {
  EnvConfig config = env;
  config.task = ruled.task;
  config.navmesh = ruled.navmesh;
  config.seed = ruled.seed;
  config.agents = 1;
  config.observation.waveform = true;
  config.order = EpisodeOrder::once;
  config.autoreset = Autoreset::off;
  config.threads = 1;
  config.prefetch = false;
  config.stage_limit_s = 0;
  config.quarantine_dir.clear();
  config.field_store.clear();  // an episode leaves no files behind
  config.scene_store.clear();
  return config;
}

glm::vec3 place_of(const EpisodeSource& source, double t_s, const Scene& scene) {
  glm::dvec3 place = source.position;
  if (!source.path.empty()) {
    place = source.path.front().position;
    for (std::size_t i = 0; i < source.path.size(); ++i) {
      const Waypoint& next = source.path[i];
      if (t_s >= next.t_s) {
        place = next.position;
      } else if (i > 0) {
        const Waypoint& last = source.path[i - 1];
        place = last.position + (next.position - last.position) * ((t_s - last.t_s) / (next.t_s - last.t_s));
        break;
      } else {
        break;
      }
    }
  }
  return scene.to_local(place);
}

std::vector<glm::vec3> source_places(const Episode& episode, double t_s, const Scene& scene) {
  if (episode.sources.empty()) return {scene.to_local(episode.goal_position)};
  std::vector<glm::vec3> places;
  for (const EpisodeSource& source : episode.sources) places.push_back(place_of(source, t_s, scene));
  return places;
}

/// EpisodeRecording::playing of a source in an episode of `count` observations, each with the sound of the step before it.
std::optional<std::array<std::size_t, 2>> playing_steps(const EpisodeSource& source, const EnvConfig& env, std::size_t count) {
  const auto step_s = static_cast<double>(env.task.step_time_s), rate_hz = static_cast<double>(env.acoustics.sample_rate_hz);
  double end_s = source.duration_s < 0 ? std::numeric_limits<double>::infinity() : source.onset_s + source.duration_s;
  if (!source.loop) {
    const SoundClip clip = open_sound(resolve_sound(source.sound, env.sound_root), env.acoustics.sample_rate_hz);
    end_s = std::min(end_s, source.onset_s + static_cast<double>(clip.samples.size()) / rate_hz);
  }
  std::optional<std::array<std::size_t, 2>> steps;
  for (std::size_t k = 0; k < count; ++k) {
    const double to_s = static_cast<double>(k) * step_s, from_s = to_s - step_s, half_sample_s = 0.5 / rate_hz;
    if (to_s <= source.onset_s + half_sample_s || from_s >= end_s - half_sample_s) continue;
    if (!steps) steps = {k, k};
    (*steps)[1] = k;
  }
  return steps;
}

/// Positions of the oracle, and its number of actions.
void walk_oracle(const TaskConfig& task, const Navmesh& navmesh, const NearestGoal& goal, const Pose& start, EpisodeRecording& recording) {
  TaskConfig relaxed = task;
  relaxed.max_steps = 4 * task.max_steps;
  AvNavState state;
  state.begin(relaxed, goal, start.position, start.heading_rad, 1);
  recording.oracle = {start.position};
  while (!state.terminated() && !state.truncated()) {
    state.step(relaxed, navmesh, goal, oracle_action(relaxed, goal, state.pose(relaxed)));
    const glm::vec3 place = state.pose(relaxed).position;
    if (place != recording.oracle.back()) recording.oracle.push_back(place);
  }
  recording.oracle_actions = state.steps();
}

/// Turns what the env shows into observations of the recording.
class Recorder {
 public:
  Recorder(const BatchedEnv& env, EpisodeRecording& recording)
      : env_(&env),
        recording_(&recording),
        camera_(camera_of(env.config(), recording.config)),
        bearing_(env.config().acoustics.sample_rate_hz),
        response_(static_cast<std::size_t>(InterauralBearing::kNumAngles)) {
    const ListenerLayout layout = env.config().observation.layout();
    num_channels_ = static_cast<std::size_t>(layout.num_channels());
    const bool has_sides = layout.kind == ListenerKind::binaural || (layout.kind == ListenerKind::array && num_channels_ > 1);
    right_channel_ = has_sides ? 1 : 0;
    recording.samples_per_step = static_cast<int>(float_rows(env, "waveform").size() / num_channels_);
  }

  /// ended: the last step ended the episode, whose rows are the final ones.
  void observe(bool ended) {
    RecordedStep step;
    const Scene& scene = *recording_->scene->scene;
    step.pose = env_->agent(0).pose;
    step.reward = recording_->steps.empty() ? 0.f : env_->rewards()[0];
    step.collided = !recording_->steps.empty() && env_->collided()[0] != 0;
    const NearestGoal goal = env_->goal(0);
    step.walk_m = goal.distance_m(step.pose.position).value_or(std::numeric_limits<float>::quiet_NaN());
    const glm::vec3 toward = goal.nearest(step.pose.position).goal() - step.pose.position;
    step.straight_m = std::hypot(toward.x, toward.z);
    step.bearing_rad = bearing_rad(toward, step.pose.heading_rad);
    const double t_s = static_cast<double>(recording_->steps.size()) * static_cast<double>(env_->config().task.step_time_s);
    step.sources = source_places(recording_->episode, t_s, scene);
    hear(rows("waveform", ended), step);
    const auto depth = rows("depth", ended);
    step.depth.assign(depth.begin(), depth.end());
    step.rgb.resize(3 * static_cast<std::size_t>(recording_->config.width_px) * static_cast<std::size_t>(recording_->config.height_px));
    camera_.render(scene, recording_->looks.get(), step.pose, {.rgb = step.rgb});
    recording_->steps.push_back(std::move(step));
  }

 private:
  static CameraSensorConfig camera_of(const EnvConfig& env, const RecordingConfig& config) {
    CameraSensorConfig camera = sensor_of(env.observation.camera);
    camera.width_px = config.width_px;
    camera.height_px = config.height_px;
    return camera;
  }

  [[nodiscard]] std::span<const float> rows(std::string_view name, bool final) const {
    const SensorSpec* sensor = find_sensor(env_->sensors(), name);
    if (!sensor || sensor->type != SensorType::float32) return {};
    return as_floats(final ? env_->final_rows(name) : env_->rows(name));
  }

  void hear(std::span<const float> sound, RecordedStep& step) {
    const std::size_t samples = sound.size() / num_channels_;
    double loudest = 0;
    for (std::size_t ear = 0; ear < 2; ++ear) {
      const auto part = sound.subspan((ear == 0 ? 0 : right_channel_) * samples, samples);
      double energy = 0;
      for (const float value : part) energy += static_cast<double>(value) * static_cast<double>(value);
      const double rms = std::sqrt(energy / static_cast<double>(std::max<std::size_t>(1, samples)));
      loudest = std::max(loudest, rms);
      step.level_db[ear] = 20 * std::log10(std::max(rms, kSilentRms));
      ears_[ear].insert(ears_[ear].end(), part.begin(), part.end());
    }
    constexpr std::size_t least = 512;  // of InterauralBearing
    if (loudest <= kSilentRms || samples < least || !env_->config().observation.has_ears()) return;
    const auto estimate = bearing_.estimate(sound, response_);
    if (!estimate.silent) step.heard_rad = estimate.lateral_rad;
  }

 public:
  void finish() {
    recording_->sound = std::move(ears_[0]);
    recording_->sound.insert(recording_->sound.end(), ears_[1].begin(), ears_[1].end());
  }

 private:
  const BatchedEnv* env_;
  EpisodeRecording* recording_;
  EmbreeCamera camera_;
  InterauralBearing bearing_;
  std::vector<float> response_;
  std::size_t num_channels_ = 2, right_channel_ = 1;  ///< in the place of the ears: the first two of an array, the first of harmonics
  std::array<std::vector<float>, 2> ears_;
};

/// The first number of the row that its actions do not give, in words; empty: they give all.
std::string difference(const EpisodeMetrics& claimed, const EpisodeMetrics& now) {
  const auto same_bits = [](double a, double b) { return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b); };
  const auto differs = [](const char* name, double a, double b) {
    return fmt::format("reports {} = {}, but its actions give {}", name, a, b);
  };
  if (claimed.steps != now.steps) return differs("steps", claimed.steps, now.steps);
  if (!same_bits(claimed.success, now.success)) return differs("success", claimed.success, now.success);
  if (!same_bits(claimed.spl, now.spl)) return differs("spl", claimed.spl, now.spl);
  if (!same_bits(claimed.soft_spl, now.soft_spl)) return differs("soft_spl", claimed.soft_spl, now.soft_spl);
  if (!same_bits(claimed.dtg_m, now.dtg_m)) return differs("dtg_m", claimed.dtg_m, now.dtg_m);
  if (!same_bits(claimed.reward, now.reward)) return differs("reward", claimed.reward, now.reward);
  return {};
}

}  // namespace

EpisodeRecording record_episode(const EvaluationResult& result, const std::string& where, const EpisodeSet& set, std::size_t index,
                                const EnvConfig& env, const RecordingConfig& config, const PolicyObserver& observer) {
  const FlushDenormals flush;
  EARSHOT_EXPECT(index < result.episodes.size());
  const EvaluationResult::Row& row = result.episodes[index];
  const std::string place = fmt::format("episode {} ('{}' in {})", index, row.id, row.scene);
  if (index >= set.episodes.size() || set.episodes[index].episode_id != row.id || set.episodes[index].scene_id != row.scene)
    throw InputError(where, place + " is not in the episode set", "give the episode set of the result with --episodes");
  const RuledEnv ruled = env_of_rules(result.rules, where, env.scene_root, env.sound_root);

  EpisodeRecording recording;
  recording.env = recording_env(env, ruled.env);
  validate(recording.env);
  recording.episode = set.episodes[index];
  recording.index = index;
  recording.actions = row.actions;
  recording.config = config;
  const auto envs = static_cast<std::size_t>(ruled.num_envs);
  auto single_episode = std::make_shared<EpisodeSet>();
  single_episode->episodes = {recording.episode};
  single_episode->hash = episode_set_hash(single_episode->episodes);
  BatchedEnv batch(recording.env, single_episode, make_scene_cache(recording.env), 1, static_cast<int>(index % envs), ruled.num_envs);
  const auto fault = batch.begin(0, 0, static_cast<int>(index / envs));
  if (fault) throw InputError(where, place + " cannot start: " + fault->detail, "check that its scene and sounds exist");
  recording.scene = batch.source(0).scene;
  recording.looks = recording.scene->looks->of(*recording.scene->scene);
  for (const glm::dvec3 goal : {recording.episode.goal_position}) recording.goals.push_back(recording.scene->scene->to_local(goal));
  for (const glm::dvec3 goal : recording.episode.other_goals) recording.goals.push_back(recording.scene->scene->to_local(goal));
  walk_oracle(recording.env.task, recording.scene->navmesh, batch.goal(0), batch.agent(0).pose, recording);

  Recorder recorder(batch, recording);
  recorder.observe(false);
  std::optional<FinishedEpisode> finished;
  for (const std::int8_t action : row.actions) {
    if (finished) throw InputError(where, place + " has actions after its end", "use an unchanged result of 'earshot eval --out'");
    if (observer.judge) recording.steps.back().judgement = observer.judge(batch);
    const std::int32_t taken = action;
    batch.step(std::span(&taken, 1));
    if (observer.after_step) observer.after_step(batch);
    for (const FinishedEpisode& episode : batch.finished()) finished = episode;
    if (finished && finished->fault)
      throw InputError(where, place + " has a fault in the replay: " + finished->fault->detail, "replay its quarantine file instead");
    recorder.observe(finished.has_value());
  }
  recorder.finish();
  if (!finished) throw InputError(where, place + " has not ended after its last action", "use an unchanged result of 'earshot eval --out'");
  recording.metrics = finished->metrics;
  if (recording.episode.sources.empty()) recording.playing = {std::array{std::size_t{0}, recording.steps.size() - 1}};
  for (const EpisodeSource& source : recording.episode.sources)
    recording.playing.push_back(playing_steps(source, recording.env, recording.steps.size()));
  if (const std::string problem = difference(row.metrics, recording.metrics); !problem.empty())
    throw InputError(where, place + " " + problem, "run 'earshot verify': the result was changed, or another build made it");
  return recording;
}

std::size_t find_episode(const EvaluationResult& result, const std::string& text) {
  const std::size_t count = result.episodes.size();
  if (count == 0) throw InputError("--episode", "has no effect: the result contains no episodes", "evaluate the agent again");
  if (text == "best" || text == "median" || text == "worst") {
    std::vector<std::size_t> order(count);
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::ranges::stable_sort(order, [&](std::size_t a, std::size_t b) {
      const EpisodeMetrics &first = result.episodes[a].metrics, &second = result.episodes[b].metrics;
      return first.spl != second.spl ? first.spl > second.spl : first.steps < second.steps;
    });
    return text == "best" ? order.front() : text == "worst" ? order.back() : order[count / 2];
  }
  std::size_t index = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), index);
  if (error != std::errc() || end != text.data() + text.size() || index >= count)
    throw InputError("--episode " + text, fmt::format("is out of range: the result contains {} episodes", count),
                     fmt::format("write a number from 0 to {}, or best, median or worst", count - 1));
  return index;
}

}  // namespace earshot
