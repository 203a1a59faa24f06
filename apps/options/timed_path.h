// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <string>
#include <vector>

namespace earshot {

struct TimedPose {
  double t_s = 0;
  glm::dvec3 position{0};
  double heading_deg = 0;
};

/// Reads a CSV, decimal points whatever the locale, with the columns t_s,x,y,z,heading_deg, times rising; a header line and lines that
/// begin with # are skipped. Throws InputError naming file and line, also of a last line without a line feed, which may have been cut.  At
/// least two poses.
std::vector<TimedPose> read_timed_path(const std::string& path);

/// Linear between poses, held beyond the ends; the heading turns the short way round.  path: not empty.
TimedPose pose_at(const std::vector<TimedPose>& path, double t_s);

}  // namespace earshot
