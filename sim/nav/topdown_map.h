// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <span>

#include "sim/nav/walkable_map.h"

namespace earshot {

class ConfigReader;

/// How a map is turned and where its middle is.
enum class MapFrame {
  egocentric,   ///< the agent in the middle, its heading upwards
  allocentric,  ///< the middle of the walkable surface in the middle, -z upwards and x to the right, as the axes of the scene lie
};

struct TopdownMapConfig {
  int size_px = 64;              ///< [8, 1024], both sides
  float metres_per_px = 0.125f;  ///< [0.02, 1]; above 0.3 walls between rooms may be missed
  MapFrame frame = MapFrame::egocentric;
  bool goal = false;  ///< a fourth channel for the goals: for oracles and videos, it gives the answer away
};
/// Reads the fields by their names over `config`.  Throws InputError.
void read(ConfigReader& reader, TopdownMapConfig& config);
/// Throws InputError naming key, value and what is allowed.
void validate(const TopdownMapConfig& config);

inline int map_channels(const TopdownMapConfig& config) { return config.goal ? 4 : 3; }

/// Marks drawn over the walkable surface.
struct MapMarks {
  glm::vec3 position{0};  ///< of the agent, foot point
  double heading_rad = 0;
  std::span<const glm::vec3> path = {};   ///< where it has been, from its start on
  std::span<const glm::vec3> goals = {};  ///< drawn if the config says so
};

/// A picture from above of the storey that the agent is on, row-major [size, size, channels], rows from top to bottom.  Channels hold 255
/// or 0: the walkable surface; the path; the agent, as a disc of kAgentRadiusM with a line of three radii along its heading; the goals, as
/// discs of kGoalRadiusM.  Discs are three pixels wide at least.  About 8 ns per pixel, no allocation, safe from any thread.
void draw_topdown_map(const TopdownMapConfig& config, const WalkableMap& map, const MapMarks& marks, std::span<std::uint8_t> image);
inline constexpr float kAgentRadiusM = 0.15f, kGoalRadiusM = 0.25f;

}  // namespace earshot
