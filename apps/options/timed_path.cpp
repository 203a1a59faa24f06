// SPDX-License-Identifier: Apache-2.0
#include "apps/options/timed_path.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <iterator>
#include <locale>
#include <sstream>

#include "sim/base/coordinates.h"
#include "sim/base/errors.h"

namespace earshot {

std::vector<TimedPose> read_timed_path(const std::string& path) {
  std::ifstream stream(path);
  if (!stream) throw InputError(path, "cannot be opened", "name a CSV file with the columns t_s,x,y,z,heading_deg");
  std::vector<TimedPose> poses;
  int line_number = 0;
  for (std::string line; std::getline(stream, line);) {
    ++line_number;
    if (line_number == 1 && line.starts_with("\xEF\xBB\xBF")) line.erase(0, 3);
    if (stream.eof())
      throw InputError(fmt::format("{}:{}", path, line_number), "is incomplete: the last line has no line feed",
                       "write the file again, or add a line feed if the line is complete");
    if (line.empty() || line == "\r" || line.starts_with("#") || line.starts_with("t_s")) continue;
    std::istringstream fields(line);
    fields.imbue(std::locale::classic());
    TimedPose pose;
    std::array<char, 4> commas{};
    fields >> pose.t_s >> commas[0] >> pose.position.x >> commas[1] >> pose.position.y >> commas[2] >> pose.position.z >> commas[3] >>
        pose.heading_deg;
    const bool complete = !fields.fail() && (fields >> std::ws).eof();
    const bool possible = std::isfinite(pose.t_s) && is_valid_position(pose.position) && std::isfinite(pose.heading_deg);
    if (!complete || commas != std::array{',', ',', ',', ','} || !possible)
      throw InputError(fmt::format("{}:{}", path, line_number), "does not have the columns t_s,x,y,z,heading_deg",
                       fmt::format("write five finite numbers, positions within {:g} m", kMaxCoordinateM));
    if (!poses.empty() && pose.t_s <= poses.back().t_s)
      throw InputError(fmt::format("{}:{}", path, line_number), "t_s is not larger than on the line before", "sort the poses by t_s");
    poses.push_back(pose);
  }
  if (poses.size() < 2) throw InputError(path, "contains fewer than two poses", "give at least a start and an end pose");
  return poses;
}

TimedPose pose_at(const std::vector<TimedPose>& path, double t_s) {
  if (path.size() == 1) return {t_s, path[0].position, path[0].heading_deg};
  // The first later pose, of all but the first and the last.
  const auto next = std::lower_bound(path.begin() + 1, path.end() - 1, t_s, [](const TimedPose& pose, double t) { return pose.t_s < t; });
  const TimedPose &a = *std::prev(next), &b = *next;
  const double fraction = std::clamp((t_s - a.t_s) / (b.t_s - a.t_s), 0.0, 1.0);
  const double turn_deg = std::remainder(b.heading_deg - a.heading_deg, 360.0);
  return {t_s, a.position + fraction * (b.position - a.position), a.heading_deg + fraction * turn_deg};
}

}  // namespace earshot
