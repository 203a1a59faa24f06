// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "envs/episodes/agent_scenario.h"
#include "envs/episodes/episode_generator.h"
#include "envs/episodes/sound_scenario.h"

namespace earshot {

/// A set of episodes and how to generate it.
struct DataConfig {
  std::string file;                 ///< the set, relative to the working folder
  std::vector<std::string> scenes;  ///< SCENEs; "house:10..14,rooms=3" stands for five of them
  std::vector<std::string> sounds;  ///< drawn per episode; "synth:bird:0..3" stands for four, a folder for its sound files
  int episodes_per_scene = 50;
  int goals_per_scene = 0;  ///< places of the source that the episodes of a scene share, far from each other; 0: each has one of its own
  std::uint64_t seed = 0;
  EpisodeFilter filter;
  SoundScenario scenario;
  AgentScenario agents;
};

/// All keys of a section, validated.  Throws InputError naming the key, its value and the rule.
void read(ConfigReader& reader, DataConfig& data);

}  // namespace earshot
