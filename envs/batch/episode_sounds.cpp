// SPDX-License-Identifier: Apache-2.0
#include "envs/batch/episode_sounds.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <glm/vec3.hpp>
#include <numbers>
#include <string>
#include <utility>

#include "envs/batch/env_run.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

constexpr std::uint64_t kNoEnd = ~std::uint64_t{0};

/// A sound that begins and ends at these samples of the stream, from its beginning.
PlayedSound played_from(const LibrarySound& sound, std::uint64_t begin, std::uint64_t end, float level_db) {
  const std::uint64_t length = sound.clip.samples.size();
  return {.sound = &sound,
          .position = {.clip_offset = (length - begin % length) % length, .already_playing = false, .begin = begin, .end = end},
          .gain = std::pow(10.f, level_db / 20.f)};
}

float rms_at_1_m(const PlayedSound& played) {
  const std::vector<float>& samples = played.sound->clip.samples;
  double sum = 0;
  for (const float sample : samples) sum += static_cast<double>(sample) * static_cast<double>(sample);
  return played.gain * static_cast<float>(std::sqrt(sum / static_cast<double>(samples.size())) / (4.0 * std::numbers::pi));
}

glm::vec3 above(const BatchSetup& setup, glm::vec3 foot) { return foot + glm::vec3(0, setup.config.task.source_height_m, 0); }

glm::vec3 source_at(const BatchSetup& setup, const EnvScene& scene, glm::dvec3 foot) { return above(setup, scene.scene->to_local(foot)); }

}  // namespace

/// The sound of an episode without `sources`: it has always been playing.
void EpisodeSounds::add_goal(const BatchSetup& setup, const Agent& lead) {
  const LibrarySound& sound = setup.sounds.sound(setup.set->episodes[lead.episode_index].sound);
  const RandomStream random(lead.seed, Purpose::sound, lead.stream, static_cast<std::uint32_t>(lead.episode_count));
  const std::uint32_t offset = random.below(static_cast<std::uint32_t>(sound.clip.samples.size()), 0);
  sounds_.push_back({.played = {.source = lead.source.get(), .sound = &sound, .position = {.clip_offset = offset}}});
}

void EpisodeSounds::add_source(const BatchSetup& setup, const Agent& lead, const EpisodeSource& source) {
  const auto& scene = lead.source->scene;
  const LibrarySound& sound = setup.sounds.sound(source.sound);
  const double rate_hz = static_cast<double>(setup.config.acoustics.sample_rate_hz);
  // The first window is the second before the episode.
  const auto begin = static_cast<std::uint64_t>(setup.window_samples() + std::llround(source.onset_s * rate_hz));
  std::uint64_t end = kNoEnd;
  if (source.duration_s >= 0) end = begin + static_cast<std::uint64_t>(std::llround(source.duration_s * rate_hz));
  if (!source.loop) end = std::min(end, begin + sound.clip.samples.size());
  Sound made{.played = played_from(sound, begin, end, source.level_db)};
  if (source.path.empty()) {
    const std::string& scene_id = setup.set->episodes[lead.episode_index].scene_id;
    sources_.push_back(setup.scenes->source(scene_id, source.position, setup.config.task.source_height_m));
    made.played.source = sources_.back().get();
  } else {
    std::vector<TimedPlace> path;
    for (const Waypoint& at : source.path)
      path.push_back({.sample = setup.window_samples() + at.t_s * rate_hz, .position = source_at(setup, *scene, at.position)});
    made.moving = std::make_unique<MovingSource>(scene, source_at(setup, *scene, source.position), std::move(path));
  }
  sounds_.push_back(std::move(made));
}

/// Agents sound from the start of the episode on, from the height of sources above where they are.
void EpisodeSounds::add_agents(const BatchSetup& setup, std::span<const Agent> agents) {
  if (agents.size() <= 1) return;
  const Episode& episode = setup.set->episodes[agents.front().episode_index];
  for (const Agent& agent : agents) {
    const EpisodeAgent* further = agent.number > 0 ? &episode.other_agents[size_of(agent.number - 1)] : nullptr;
    const std::string& name = further ? further->sound : episode.agent_sound;
    if (name.empty()) continue;
    const float level_db = further ? further->level_db : episode.agent_level_db;
    sounds_.push_back({.played = played_from(setup.sounds.sound(name), size_of(setup.window_samples()), kNoEnd, level_db),
                       .moving = std::make_unique<MovingSource>(agents.front().source->scene, above(setup, agent.start_pose.position)),
                       .agent = agent.number});
  }
}

void EpisodeSounds::begin(const BatchSetup& setup, std::span<Agent> agents) {
  const Agent& lead = agents.front();
  const Episode& episode = setup.set->episodes[lead.episode_index];
  float noise_reference = 0;  // root mean square of the goal's sound at 1 m
  const auto may_be_reference = [&](bool is_goal) {
    if (episode.noise_snr_db && (is_goal || noise_reference == 0)) noise_reference = rms_at_1_m(sounds_.back().played);
  };
  if (episode.sources.empty()) {
    add_goal(setup, lead);
    may_be_reference(true);
  }
  for (const EpisodeSource& source : episode.sources) {
    add_source(setup, lead, source);
    may_be_reference(source.goal);
  }
  add_agents(setup, agents);
  for (Sound& sound : sounds_) {
    sound.played.moving = sound.moving.get();
    sound.played.restarts = setup.config.sound_restarts;
  }

  BackgroundNoise noise{.seed = lead.seed, .stream = lead.stream, .episode = static_cast<std::uint32_t>(lead.episode_count)};
  if (episode.noise_snr_db) noise.rms = noise_reference * std::pow(10.f, -*episode.noise_snr_db / 20.f);
  for (Agent& agent : agents) {
    played_.clear();
    for (const Sound& sound : sounds_)
      if (sound.agent != agent.number) played_.push_back(sound.played);
    noise.agent = static_cast<std::uint32_t>(agent.number);
    agent.hearing.begin(played_, noise);
  }
}

void EpisodeSounds::move(const BatchSetup& setup, int steps, std::span<const Agent> agents, const HearingEngines* engines,
                         AgentTeam* team) {
  if (!engines || sounds_.empty()) return;
  const std::size_t window = size_of(setup.window_samples()), block = size_of(setup.block_samples);
  const std::uint64_t last = window + size_of(steps) * block;  // sample at which the step ends
  const auto move_one = [&](Sound& sound) {
    if (!sound.moving) return;
    const int new_samples = steps == 0 ? static_cast<int>(window) : setup.block_samples;
    PlayedSound now = sound.played;
    now.position.sample = last - static_cast<std::uint64_t>(new_samples);
    if (!sounds_within(now, size_of(engines->max_rir_samples), new_samples)) return;
    if (sound.agent < 0)
      sound.moving->move_to(sound.moving->place_at(static_cast<double>(last)));
    else
      sound.moving->move_to(above(setup, agents[size_of(sound.agent)].state.pose(setup.config.task).position));
  };
  if (team)
    team->run(sounds_.size(), [&](std::size_t i, std::size_t) {
      try {
        move_one(sounds_[i]);
      } catch (...) {
        sounds_[i].error = std::current_exception();
      }
    });
  else
    for (Sound& sound : sounds_) move_one(sound);
  for (Sound& sound : sounds_)
    if (sound.error) std::rethrow_exception(std::exchange(sound.error, nullptr));
}

void EpisodeSounds::clear() {
  sounds_.clear();
  sources_.clear();
}

}  // namespace earshot
