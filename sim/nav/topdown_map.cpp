// SPDX-License-Identifier: Apache-2.0
#include "sim/nav/topdown_map.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <glm/geometric.hpp>

#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

enum Channel : std::size_t { walkable_channel, path_channel, agent_channel, goal_channel };

/// Between metres in the scene and pixels of a map, seen from above.
class MapView {
 public:
  MapView(const TopdownMapConfig& config, const WalkableMap& map, const MapMarks& marks, std::span<std::uint8_t> image)
      : size_(config.size_px), channels_(static_cast<std::size_t>(map_channels(config))), per_px_(config.metres_per_px), image_(image) {
    const bool is_egocentric = config.frame == MapFrame::egocentric;
    const glm::vec2 middle = 0.5f * (map.low() + map.high());
    middle_ = is_egocentric ? glm::vec2(marks.position.x, marks.position.z) : middle;
    const double heading = is_egocentric ? marks.heading_rad : 0.0;
    // forward_of(h) = (-sin h, 0, -cos h) is up, right_of(h) = (cos h, 0, -sin h) to the right.
    up_ = {-static_cast<float>(std::sin(heading)), -static_cast<float>(std::cos(heading))};
    right_ = {-up_.y, up_.x};
  }

  /// Of the middle of a pixel.
  [[nodiscard]] glm::vec2 metres(int row, int column) const {
    const float right = (static_cast<float>(column) + 0.5f - 0.5f * static_cast<float>(size_)) * per_px_;
    const float up = (0.5f * static_cast<float>(size_) - static_cast<float>(row) - 0.5f) * per_px_;
    return middle_ + right * right_ + up * up_;
  }
  /// (column, row) of a place, fractional.
  [[nodiscard]] glm::vec2 pixel(glm::vec3 place) const {
    const glm::vec2 away = glm::vec2(place.x, place.z) - middle_;
    const float half = 0.5f * static_cast<float>(size_);
    return {half + glm::dot(away, right_) / per_px_, half - glm::dot(away, up_) / per_px_};
  }
  void set(int row, int column, Channel channel, bool on) {
    image_[(static_cast<std::size_t>(row) * static_cast<std::size_t>(size_) + static_cast<std::size_t>(column)) * channels_ + channel] =
        on ? 255 : 0;
  }
  void mark(glm::vec2 at, Channel channel) {
    if (at.x >= 0 && at.y >= 0 && at.x < static_cast<float>(size_) && at.y < static_cast<float>(size_))
      set(static_cast<int>(at.y), static_cast<int>(at.x), channel, true);
  }
  /// In steps of half a pixel, as far as it can be seen.
  void line(glm::vec2 from, glm::vec2 to, Channel channel) {
    const float side = static_cast<float>(size_);
    if (std::max(from.x, to.x) < 0 || std::max(from.y, to.y) < 0 || std::min(from.x, to.x) > side || std::min(from.y, to.y) > side) return;
    const float length = glm::length(to - from);
    const int steps = std::min(static_cast<int>(2 * length) + 1, 8 * size_);
    for (int i = 0; i <= steps; ++i) mark(from + (static_cast<float>(i) / static_cast<float>(steps)) * (to - from), channel);
  }
  void disc(glm::vec2 at, float radius_m, Channel channel) {
    const float radius = std::max(radius_m / per_px_, 1.f);
    // Clipped as floats: a place far outside would overflow an int.
    const auto clip = [&](float value) { return static_cast<int>(std::clamp(value, 0.f, static_cast<float>(size_ - 1))); };
    for (int row = clip(at.y - radius - 1); row <= clip(at.y + radius + 1); ++row)
      for (int column = clip(at.x - radius - 1); column <= clip(at.x + radius + 1); ++column)
        if (glm::length(glm::vec2(static_cast<float>(column) + 0.5f, static_cast<float>(row) + 0.5f) - at) <= radius)
          set(row, column, channel, true);
  }
  [[nodiscard]] float per_px() const { return per_px_; }

 private:
  int size_;
  std::size_t channels_;
  float per_px_;
  std::span<std::uint8_t> image_;
  glm::vec2 middle_{0}, up_{0}, right_{0};
};

}  // namespace

void read(ConfigReader& reader, TopdownMapConfig& config) {
  reader.read("size_px", config.size_px, Allowed::between(8, 1024), "Width and height of the map.");
  reader.read("metres_per_px", config.metres_per_px, Allowed::between(0.02, 1),
              "Edge of a pixel in the scene; above 0.3 m walls between rooms may be missed.");
  reader.read_choice<MapFrame>("frame", config.frame, {{"egocentric", MapFrame::egocentric}, {"allocentric", MapFrame::allocentric}},
                               "Axes of the map. egocentric: agent in the middle, heading up. allocentric: fixed to the scene.");
  reader.read("goal", config.goal, "A fourth channel that shows the goals; it gives the answer away.");
}

void validate(const TopdownMapConfig& config) { check_values(config, "observation.map"); }

void draw_topdown_map(const TopdownMapConfig& config, const WalkableMap& map, const MapMarks& marks, std::span<std::uint8_t> image) {
  const auto side = static_cast<std::size_t>(config.size_px);
  EARSHOT_EXPECT(image.size() == side * side * static_cast<std::size_t>(map_channels(config)));
  std::fill(image.begin(), image.end(), std::uint8_t{0});
  MapView view(config, map, marks, image);
  const float height = marks.position.y;
  for (int row = 0; row < config.size_px; ++row)
    for (int column = 0; column < config.size_px; ++column) {
      const glm::vec2 at = view.metres(row, column);
      if (map.walkable(at.x, at.y, height)) view.set(row, column, walkable_channel, true);
    }
  const auto on_this_storey = [&](glm::vec3 place) { return std::fabs(place.y - height) <= WalkableMap::kStoreyM; };
  for (std::size_t i = 1; i < marks.path.size(); ++i)
    if (on_this_storey(marks.path[i - 1]) && on_this_storey(marks.path[i]))
      view.line(view.pixel(marks.path[i - 1]), view.pixel(marks.path[i]), path_channel);
  const glm::vec2 agent = view.pixel(marks.position);
  const glm::vec3 ahead(-std::sin(marks.heading_rad), 0, -std::cos(marks.heading_rad));
  const float radius_m = std::max(kAgentRadiusM, view.per_px());
  view.disc(agent, radius_m, agent_channel);
  view.line(agent, view.pixel(marks.position + 3.f * radius_m * ahead), agent_channel);
  if (!config.goal) return;
  for (const glm::vec3& goal : marks.goals)
    if (on_this_storey(goal)) view.disc(view.pixel(goal), kGoalRadiusM, goal_channel);
}

}  // namespace earshot
