// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>
#include <vector>

#include "envs/episodes/episode_generator.h"

namespace earshot {

/// How many agents generated episodes have, and what they sound like.  As it stands: one, silent.
struct AgentScenario {
  int count = 1;                         ///< in all, [1, kMaxAgents]
  float apart_m = 1;                     ///< least straight distance of any two starts
  std::vector<std::string> sounds = {};  ///< drawn for each agent, the first one too; empty: none makes any
  float level_db = 0;                    ///< of them
};
void read(ConfigReader& reader, AgentScenario& scenario);
/// Throws InputError "key = value: rule".
void validate(const AgentScenario& scenario);

/// Gives the episodes of one scene their further agents: starts uniform on the largest island with free air up to the ears, apart from each
/// other, on a path to the goal of a length that the filter allows (its ratio does not count); headings uniform over multiples of the turn.
/// A function of the arguments.  request: task, filter and seed of the episodes; nothing else of it is used.  Throws
/// InputError if no place is found in filter.max_tries.
void apply_agents(const AgentScenario& scenario, const Scene& scene, const Navmesh& navmesh, const EpisodeRequest& request,
                  std::span<Episode> episodes);

}  // namespace earshot
