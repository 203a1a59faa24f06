// SPDX-License-Identifier: Apache-2.0
#include "tests/support/acoustics/measured_room.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <glm/geometric.hpp>

#include "sim/acoustics/paths/early_reflections.h"

namespace earshot {
namespace {

using measured_room::kSouth;
using measured_room::kWalls;

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return 0.5 * (values[(values.size() - 1) / 2] + values[values.size() / 2]);
}

/// First-order arrivals of the engine for each microphone, in the order of the walls, milliseconds after emission; then the direct sound.
std::vector<std::array<double, 7>> simulated_arrivals_ms(const measured_room::Room& room) {
  AcousticConfig config = rooms::plain_config();
  config.early = Switch::automatic;
  config.early_order = 1;
  const AcousticScene scene(measured_room::scene_of(room, rooms::uniform_walls(0.1, 0)), config);
  const EarlyCandidates candidates(scene, measured_room::point_in(room, room.source_m));
  std::vector<std::array<double, 7>> times;
  for (const measured_room::Microphone& mic : room.microphones) {
    std::vector<Arrival> arrivals;
    candidates.find_arrivals(scene, measured_room::point_in(room, mic.position_m), arrivals);
    EXPECT_EQ(arrivals.size(), 7u);
    std::array<double, 7> of_wall{};
    for (const Arrival& arrival : arrivals) {
      const double time_ms = 1e3 * arrival.distance_m / room.speed_of_sound_m_per_s;
      if (arrival.order == 0) {
        of_wall[6] = time_ms;
        continue;
      }
      // A first-order path changes the sign of one component between leaving and arriving: that of its wall's normal.
      const std::array<glm::vec3, 3> axes{rooms::point(1, 0, 0), rooms::point(0, 1, 0), rooms::point(0, 0, 1)};
      for (int axis = 0; axis < 3; ++axis) {
        const float leaving = glm::dot(arrival.departure, axes[axis]), looking = glm::dot(arrival.direction, axes[axis]);
        if (leaving * looking > 0) of_wall[2 * axis + (looking > 0 ? 1 : 0)] = time_ms;
      }
    }
    times.push_back(of_wall);
  }
  return times;
}

TEST(DEchorate, ArrivalTimesOfDirectSoundAndFirstReflections) {
  SKIP_WITHOUT_DATA("rir/dechorate/dechorate_011111.json");
  const auto room = measured_room::load();
  const auto times_ms = simulated_arrivals_ms(*room);
  int judged = 0, near = 0;
  std::printf("simulated minus annotated, ms; microphones 0 to 5\n");
  for (int wall = 0; wall < 7; ++wall) {
    std::vector<double> errors_ms, sizes_ms;
    for (std::size_t m = 0; m < room->microphones.size(); ++m) {
      const auto& mic = room->microphones[m];
      errors_ms.push_back(times_ms[m][wall] - 1e3 * (wall == 6 ? mic.direct_s : mic.reflection_s[wall]));
      sizes_ms.push_back(std::fabs(errors_ms.back()));
    }
    const char* name = wall == 6 ? "direct" : kWalls[wall];
    std::printf("%-8s", name);
    for (const double error_ms : errors_ms) std::printf(" %+.3f", error_ms);
    std::printf("   median size %.3f, worst %.3f%s\n", median(sizes_ms), *std::max_element(sizes_ms.begin(), sizes_ms.end()),
                wall == kSouth ? "   (annotation unreliable, not judged)" : "");
    if (wall == kSouth) continue;
    // The bound.  Positions are known to a centimetre or two (0.03 to 0.06 ms), annotations are picked by hand.
    EXPECT_LT(median(sizes_ms), 0.2) << name;
    for (const double size_ms : sizes_ms) {
      ++judged;
      near += size_ms < 0.3 ? 1 : 0;
      EXPECT_LT(size_ms, 1.0) << name;
    }
    // Without a simulator: the mean of the annotations at the other microphones.  The bound tells it from one that knows the room.
    std::vector<double> without_ms;
    for (std::size_t m = 0; m < sizes_ms.size(); ++m) {
      double others_ms = 0, own_ms = 0;
      for (std::size_t other = 0; other < sizes_ms.size(); ++other) {
        const auto& mic = room->microphones[other];
        const double at_ms = 1e3 * (wall == 6 ? mic.direct_s : mic.reflection_s[wall]);
        if (other == m) {
          own_ms = at_ms;
        } else {
          others_ms += at_ms / static_cast<double>(sizes_ms.size() - 1);
        }
      }
      without_ms.push_back(std::fabs(others_ms - own_ms));
    }
    std::printf("         median size without a simulator %.3f\n", median(without_ms));
    EXPECT_GT(median(without_ms), 0.2) << name;
  }
  // Annotations are picked by hand: one in twenty may sit on another peak.
  std::printf("%d of %d within 0.3 ms\n", near, judged);
  EXPECT_EQ(judged, 36);
  EXPECT_GE(near, 34);
}

}  // namespace
}  // namespace earshot
