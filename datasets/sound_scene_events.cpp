// SPDX-License-Identifier: Apache-2.0
#include "datasets/sound_scene_events.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <glm/geometric.hpp>
#include <numbers>

#include "envs/episodes/name_ranges.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "sim/nav/geodesic_field.h"

namespace earshot {
namespace {

/// In the place of the scene in the streams of episodes: recordings of scenes, and places in them.
constexpr std::uint32_t kEventStream = 0x53454C44u, kPlaceStream = 0x53454C50u;
constexpr int kOnsetTries = 100, kWalkTries = 20;
constexpr int kMaxCorners = 200;
constexpr float kArrivedM = 0.02f;
constexpr double kFrameS = 0.1, kDegreesPerRadian = 180 / std::numbers::pi;

/// Draw numbers of an event, fixed so that a new consumer does not shift the others.
struct EventDraw {
  enum : std::uint32_t {
    class_index = 0,
    sound = 1,
    length = 2,
    moving = 3,
    speed = 4,
    level = 5,
    pattern = 6,
    instance = 7,
    heading = 8,
    pitch = 9,
    roll = 10,
    count = 11,
    onset = 32
  };
};

/// item: counted within the recording; each has a stream of its own.
RandomStream stream_of(const SoundSceneConfig& config, std::uint32_t kind, std::size_t room, int recording, int item) {
  return {config.rooms.seed, Purpose::episode, kind, static_cast<std::uint32_t>(room),
          (static_cast<std::uint32_t>(recording) << 16) | static_cast<std::uint32_t>(item)};
}

double hundredths_within(const std::vector<float>& range, float fraction) {
  return 0.01 * std::round(100.0 * static_cast<double>(range[0] + fraction * (range[1] - range[0])));
}

/// From `from` along the floor to `to`, both at their heights over it; empty if no way leads there.
std::vector<glm::vec3> way_between(const Navmesh& navmesh, FreePlace from, FreePlace to) {
  const GeodesicField field(navmesh, to.foot);
  std::vector<glm::vec3> feet{from.foot};
  for (int corner = 0; corner < kMaxCorners; ++corner) {
    const auto next = field.next_corner(feet.back());
    if (!next) return {};
    if (glm::length(*next - feet.back()) > 0.01f) feet.push_back(*next);
    if (glm::length(field.goal() - feet.back()) <= kArrivedM) break;
  }
  if (glm::length(field.goal() - feet.back()) > kArrivedM) return {};
  float length_m = 0;
  for (std::size_t i = 1; i < feet.size(); ++i) length_m += glm::length(feet[i] - feet[i - 1]);
  std::vector<glm::vec3> way;
  float along_m = 0;
  for (std::size_t i = 0; i < feet.size(); ++i) {
    if (i > 0) along_m += glm::length(feet[i] - feet[i - 1]);
    const float fraction = length_m > 0 ? along_m / length_m : 0.f;
    way.push_back(feet[i] + glm::vec3(0, from.height_m + fraction * (to.height_m - from.height_m), 0));
  }
  return way;
}

/// Points in time of a walk there and back until `length_s` is over.
std::vector<WalkPoint> timed(const std::vector<glm::vec3>& way, double speed_m_per_s, double length_s) {
  std::vector<WalkPoint> points{{0, way[0]}};
  std::size_t at = 0;
  int step = 1;
  while (points.back().t_s < length_s) {
    if (at == 0) step = 1;
    if (at + 1 == way.size()) step = -1;
    const std::size_t next = step > 0 ? at + 1 : at - 1;
    const double took_s = static_cast<double>(glm::length(way[next] - way[at])) / speed_m_per_s;
    points.push_back({points.back().t_s + std::max(took_s, 1e-3), way[next]});
    at = next;
  }
  return points;
}

/// Tells whether a source may be at a place, by its distance from the listener.
using DistanceRule = std::function<bool(glm::vec3)>;

/// A way from `start` to a drawn goal that keeps its distance everywhere; empty if none is found.
std::vector<glm::vec3> draw_way(const RirCorpusConfig& config, const CorpusRoom& room, const RandomStream& random, FreePlace start,
                                const DistanceRule& keeps_distance) {
  for (int attempt = 0; attempt < kWalkTries; ++attempt) {
    const FreePlace goal =
        room.draw_place(random, static_cast<std::uint32_t>(1 + attempt), config.source_height_m, keeps_distance, "a source that moves");
    std::vector<glm::vec3> way = way_between(room.navmesh(), start, goal);
    if (way.size() < 2) continue;
    float length_m = 0;
    bool keeps = true;
    for (std::size_t i = 1; i < way.size() && keeps; ++i) {
      length_m += glm::length(way[i] - way[i - 1]);
      constexpr int steps = 20;
      for (int step = 0; step <= steps && keeps; ++step)
        keeps = keeps_distance(way[i - 1] + (static_cast<float>(step) / steps) * (way[i] - way[i - 1]));
    }
    if (keeps && length_m >= 0.3f) return way;
  }
  return {};
}

int most_at_once(const std::vector<SoundEvent>& events, double begin_s, double end_s) {
  int most = 0;
  for (const SoundEvent& event : events) {
    // The number that sound changes at onsets only.
    const double at_s = std::max(event.onset_s, begin_s);
    if (at_s >= end_s || event.offset_s <= begin_s) continue;
    most = std::max(most, static_cast<int>(std::ranges::count_if(
                              events, [&](const SoundEvent& other) { return other.onset_s <= at_s && other.offset_s > at_s; })));
  }
  return most;
}

}  // namespace

glm::vec3 SoundEvent::position_at(double since_onset_s) const {
  std::size_t next = 0;
  while (next < path.size() && path[next].t_s <= since_onset_s) ++next;
  if (next == 0) return path.front().position;
  if (next == path.size()) return path.back().position;
  const WalkPoint &a = path[next - 1], &b = path[next];
  return a.position + static_cast<float>((since_onset_s - a.t_s) / (b.t_s - a.t_s)) * (b.position - a.position);
}

ClassSounds expand_classes(const SoundSceneConfig& config) {
  ClassSounds all;
  for (const SoundClass& sounds : config.classes) all.push_back(expand_sounds(sounds.sounds));
  return all;
}

SoundScenePlan plan_sound_scene(const SoundSceneConfig& config, const ClassSounds& sounds, const CorpusRoom& room, std::size_t room_index,
                                int recording) {
  const auto stream = [&](std::uint32_t kind, int item) { return stream_of(config, kind, room_index, recording, item); };
  const RandomStream whole = stream(kEventStream, 0);
  SoundScenePlan plan;
  const auto anywhere = [](glm::vec3) { return true; };
  plan.listener.position = room.draw_place(stream(kPlaceStream, 0), 0, config.rooms.listener_height_m, anywhere, "a listener").position();
  plan.listener.heading_deg = 0.01 * whole.below(36000, EventDraw::heading);
  plan.listener.pitch_deg = hundredths_within(config.rooms.pitch_deg, whole.uniform(EventDraw::pitch));
  plan.listener.roll_deg = hundredths_within(config.rooms.roll_deg, whole.uniform(EventDraw::roll));
  const DistanceRule keeps_distance = [&](glm::vec3 place) {
    const float distance_m = glm::length(place - plan.listener.position);
    return distance_m >= config.rooms.min_distance_m && distance_m <= config.rooms.max_distance_m;
  };
  const int count = config.events[0] +
                    static_cast<int>(whole.below(static_cast<std::uint32_t>(config.events[1] - config.events[0] + 1), EventDraw::count));
  for (int number = 1; number <= count; ++number) {
    const RandomStream random = stream(kEventStream, number);
    SoundEvent event;
    event.class_index = random.below(static_cast<std::uint32_t>(config.classes.size()), EventDraw::class_index);
    const std::vector<std::string>& among = sounds[event.class_index];
    event.sound = among[random.below(static_cast<std::uint32_t>(among.size()), EventDraw::sound)];
    if (event.sound.starts_with("synth:") && std::ranges::count(event.sound, ':') == 1)
      event.sound += fmt::format(":{}", random.below(1u << 20, EventDraw::instance));
    const double length_s = hundredths_within(config.event_s, random.uniform(EventDraw::length));
    bool fits = false;
    for (std::uint32_t attempt = 0; attempt < kOnsetTries && !fits; ++attempt) {
      event.onset_s = 0.001 * std::floor(1000 * static_cast<double>(random.uniform(EventDraw::onset + attempt)) *
                                         std::max(0.0, static_cast<double>(config.duration_s) - length_s));
      event.offset_s = event.onset_s + length_s;
      fits = most_at_once(plan.events, event.onset_s, event.offset_s) < config.max_overlap;
    }
    if (!fits) continue;
    event.level_db = hundredths_within(config.event_db, random.uniform(EventDraw::level));
    const RandomStream places = stream(kPlaceStream, number);
    const FreePlace start = room.draw_place(places, 0, config.rooms.source_height_m, keeps_distance, "a source");
    event.path = {{0, start.position()}};
    if (random.uniform(EventDraw::moving) < config.moving) {
      event.speed_m_per_s = std::max(0.01, hundredths_within(config.speed_m_per_s, random.uniform(EventDraw::speed)));
      const std::vector<glm::vec3> way = draw_way(config.rooms, room, places, start, keeps_distance);
      if (!way.empty()) event.path = timed(way, event.speed_m_per_s, length_s);
    }
    if (!event.moves()) event.speed_m_per_s = 0;
    plan.events.push_back(std::move(event));
  }
  std::ranges::stable_sort(plan.events, {}, &SoundEvent::onset_s);
  for (std::size_t i = 0; i < plan.events.size(); ++i) plan.events[i].number = static_cast<int>(i);
  return plan;
}

std::string dcase_metadata(const SoundScenePlan& plan, float duration_s) {
  const ListenerOrientation orientation = plan.listener.orientation();
  std::string lines;
  const auto frames = static_cast<int>(std::ceil(static_cast<double>(duration_s) / kFrameS - 1e-6));
  for (int frame = 0; frame < frames; ++frame) {
    const double t_s = (frame + 0.5) * kFrameS;
    for (const SoundEvent& event : plan.events) {
      if (t_s < event.onset_s || t_s >= event.offset_s) continue;
      const glm::vec3 toward = event.position_at(t_s - event.onset_s) - plan.listener.position;
      const glm::vec3 local = orientation.world_to_local(glm::normalize(toward));
      lines += fmt::format("{},{},{},{},{},{}\n", frame, event.class_index, event.number,
                           std::lround(kDegreesPerRadian * std::atan2(static_cast<double>(-local.x), static_cast<double>(-local.z))),
                           std::lround(kDegreesPerRadian * std::asin(std::clamp(static_cast<double>(local.y), -1.0, 1.0))),
                           std::lround(100 * static_cast<double>(glm::length(toward))));
    }
  }
  return lines;
}

}  // namespace earshot
