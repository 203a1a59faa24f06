// SPDX-License-Identifier: Apache-2.0
#include "envs/episodes/agent_scenario.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/random.h"
#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

/// The third counter of an episode's draws, with the agent and the attempt: the generator's own attempts stay below.
constexpr std::uint32_t kFirstOfAgents = 0x80000000u, kTriesPerAgent = 1u << 26;
struct AgentDraw {
  enum : std::uint32_t { place = 0, heading = 2, sound = 3 };
};

}  // namespace

void read(ConfigReader& reader, AgentScenario& scenario) {
  reader.read("count", scenario.count, Allowed::between(1, static_cast<double>(kMaxAgents)), "Agents of an episode.");
  reader.read("apart_m", scenario.apart_m, Allowed::between(0, 100), "Least straight distance between any two starts.");
  reader.read("sounds", scenario.sounds, Allowed::text("a sound"), "Sounds of the agents, drawn for each. Empty: agents are silent.");
  reader.read("level_db", scenario.level_db, Allowed::between(-60, 60), "Level of the agents' sounds.");
}

void validate(const AgentScenario& scenario) {
  check_values(scenario, "agents");
  require(scenario.count > 1 || scenario.sounds.empty(), "agents.sounds", scenario.sounds.size(),
          "has no effect with one agent: agents do not hear themselves");
  require(!scenario.sounds.empty() || scenario.level_db == 0, "agents.level_db", scenario.level_db, "has no effect without agents.sounds");
}

void apply_agents(const AgentScenario& scenario, const Scene& scene, const Navmesh& navmesh, const EpisodeRequest& request,
                  std::span<Episode> episodes) {
  const TaskConfig& task = request.task;
  const EpisodeFilter& filter = request.filter;
  validate(scenario);
  if (scenario.count == 1) return;
  const auto max_tries = std::min(static_cast<std::uint32_t>(filter.max_tries), kTriesPerAgent);
  for (std::size_t index = 0; index < episodes.size(); ++index) {
    Episode& episode = episodes[index];
    const auto random_of = [&](std::uint32_t agent, std::uint32_t attempt) {
      return RandomStream(request.seed, Purpose::episode, static_cast<std::uint32_t>(hash64(episode.scene_id)),
                          static_cast<std::uint32_t>(index), kFirstOfAgents + agent * kTriesPerAgent + attempt);
    };
    const auto sound_of = [&](std::uint32_t agent) {
      return scenario.sounds.empty()
                 ? std::string{}
                 : scenario.sounds[random_of(agent, 0).below(static_cast<std::uint32_t>(scenario.sounds.size()), AgentDraw::sound)];
    };
    const glm::vec3 goal = scene.to_local(episode.goal_position);
    std::vector<glm::vec3> starts{scene.to_local(episode.start_position)};
    episode.agent_sound = sound_of(0);
    episode.agent_level_db = scenario.level_db;
    episode.other_agents.clear();
    for (std::uint32_t agent = 1; agent < static_cast<std::uint32_t>(scenario.count); ++agent) {
      for (std::uint32_t attempt = 0; attempt < max_tries && starts.size() == agent; ++attempt) {
        const RandomStream random = random_of(agent, attempt);
        const glm::vec3 place = navmesh.random_point(random, AgentDraw::place);
        const auto near = [&](glm::vec3 other) { return glm::distance(place, other) < scenario.apart_m; };
        if (std::any_of(starts.begin(), starts.end(), near) || !stands_free(scene, place, task.ear_height_m)) continue;
        const auto path_m = navmesh.path_length_m(place, goal);
        if (!path_m || *path_m < filter.min_geodesic_m || *path_m > filter.max_geodesic_m) continue;
        starts.push_back(place);
        const int turns = turns_per_circle(task);
        const auto turned = static_cast<double>(random.below(static_cast<std::uint32_t>(turns), AgentDraw::heading));
        episode.other_agents.push_back({.start_position = scene.to_world(place),
                                        .start_rotation = rotation_of(turned * 2.0 * std::numbers::pi / turns),
                                        .sound = sound_of(agent),
                                        .level_db = scenario.level_db});
      }
      if (starts.size() == agent)
        throw InputError(
            episode.scene_id,
            fmt::format("no start position for agent {} of {} that is {} m from the others and {} to {} m from its goal, after {} tries",
                        agent, scenario.count, scenario.apart_m, filter.min_geodesic_m, filter.max_geodesic_m, max_tries),
            "use fewer agents, reduce agents.apart_m, widen the filter, or use a larger scene");
    }
  }
}

}  // namespace earshot
