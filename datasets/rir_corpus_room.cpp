// SPDX-License-Identifier: Apache-2.0
#include "datasets/rir_corpus_room.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>
#include <numbers>
#include <set>
#include <string_view>

#include "envs/episodes/episode_generator.h"
#include "envs/episodes/name_ranges.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/random.h"
#include "sim/base/text/log.h"
#include "sim/base/text/utf8.h"
#include "sim/scene/checks/scene_check.h"
#include "sim/scene/materials/materials.h"
#include "sim/scene/materials/semantic_materials.h"

namespace earshot {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr std::uint32_t kTries = 1000;
/// In the place of the scene in the streams of episodes: the rooms of a corpus.
constexpr std::uint32_t kCorpusStream = 0x52495243u;

/// Draw numbers of the shape of a room, fixed so that a new consumer does not shift the others.
struct ShapeDraw {
  enum : std::uint32_t { size = 0, surface = 4, materials = 16 };
};
/// The same of one try of a place.
struct PlaceDraw {
  enum : std::uint32_t { foot = 0, height = 2, heading = 3, pitch = 4, roll = 5, pattern = 6, head = 7, per_try = 8 };
};

/// The same for what is drawn again; the number of the draw is added, counted from 1.
constexpr std::uint32_t kRedrawStream = 0x52500000u;
std::uint32_t stream_of(std::uint32_t redraw) { return redraw == 0 ? kCorpusStream : kRedrawStream + redraw; }

RandomStream shape_stream(std::uint64_t seed, std::uint32_t room, std::uint32_t redraw = 0) {
  return {seed, Purpose::episode, stream_of(redraw), room, 0};
}
/// In place of the number of a source: listeners of all sources.
constexpr int kAnySource = -1;
/// listener: counted from 1; 0 is the source itself.
RandomStream place_stream(std::uint64_t seed, std::uint32_t room, int source, int listener, std::uint32_t redraw = 0) {
  return {seed, Purpose::episode, stream_of(redraw), room,
          (static_cast<std::uint32_t>(source + 1) << 16) | static_cast<std::uint32_t>(listener)};
}

float within(const std::vector<float>& range, float fraction) { return range[0] + fraction * (range[1] - range[0]); }
double heading_of(const RandomStream& random, std::uint32_t draw) { return 0.01 * random.below(36000, draw); }
/// To the hundredth, as headings are, so that a manifest shows all of it.
double angle_within(const std::vector<float>& range, float fraction) { return 0.01 * std::round(100.0 * within(range, fraction)); }

std::uint64_t materials_seed_of(std::uint64_t seed, std::uint32_t room, std::uint32_t redraw) {
  const auto words = shape_stream(seed, room, redraw).bits4(ShapeDraw::materials);
  return (std::uint64_t{words[0]} << 32) | words[1];
}

std::string shoebox_spec(const RirCorpusConfig& config, std::uint32_t room, std::uint32_t redraw = 0) {
  const ShoeboxRooms& rooms = config.shoeboxes;
  const RandomStream random = shape_stream(config.seed, room, redraw);
  std::array<double, 3> size{};
  for (std::uint32_t axis = 0; axis < 3; ++axis) {
    const float low = rooms.min_size_m[axis], high = rooms.max_size_m[axis];
    const double drawn = low + static_cast<double>(random.uniform(ShapeDraw::size + axis)) * (high - low);
    size[axis] = 0.01 * std::round(100 * drawn);
  }
  std::string walls;
  for (std::uint32_t wall = 0; wall < 6; ++wall) {
    const std::vector<std::string>& names = wall == 2 ? rooms.floor : wall == 3 ? rooms.ceiling : rooms.walls;
    if (!walls.empty()) walls += ',';
    if (names.empty()) {
      const double ratio = static_cast<double>(rooms.absorption[1]) / static_cast<double>(rooms.absorption[0]);
      // Rounded to three digits, so that the last bits of exp and log play no part.
      walls += fmt::format("{:.3f}", static_cast<double>(rooms.absorption[0]) *
                                         std::exp(std::log(ratio) * static_cast<double>(random.uniform(ShapeDraw::surface + wall))));
    } else {
      walls += names[random.below(static_cast<std::uint32_t>(names.size()), ShapeDraw::surface + wall)];
    }
  }
  return fmt::format("shoebox:{:.2f}x{:.2f}x{:.2f}@{}", size[0], size[1], size[2], walls);
}

std::shared_ptr<const Scene> load_room(const RirCorpusConfig& config, const CorpusRoomSpec& spec) {
  Scene scene = load_scene(spec.scene);
  if (spec.is_first_of_scene)
    for (const std::string& warning : scene_warnings(scene)) log_warning(spec.scene + ": " + warning);
  if (!config.randomize) return std::make_shared<const Scene>(std::move(scene));
  AcousticRandomization randomization = *config.randomize;
  randomization.seed = spec.materials_seed;
  return std::make_shared<const Scene>(randomize_materials(scene, SemanticMaterials::indoor(), MaterialDatabase::builtin(), randomization));
}

NavmeshConfig floor_of(const RirCorpusConfig& config) {
  NavmeshConfig navmesh;
  navmesh.agent_radius_m = config.clearance_m;
  return navmesh;
}

glm::quat source_orientation(double heading_deg) { return glm::angleAxis(static_cast<float>(heading_deg * kDegree), glm::vec3(0, 1, 0)); }

}  // namespace

std::vector<std::string> expand_scenes(const std::vector<std::string>& scenes) {
  constexpr std::string_view kHabitatEnd = ".scene_instance.json";
  static const std::set<std::string> endings{".glb", ".gltf", ".obj", ".ply", ".stl", ".yaml", ".yml"};
  std::vector<std::string> all;
  for (const std::string& scene : scenes) {
    if (!std::filesystem::is_directory(scene)) {
      const std::vector<std::string> expanded = expand_range(scene);
      all.insert(all.end(), expanded.begin(), expanded.end());
      continue;
    }
    std::vector<std::string> files;
    for (const auto& entry : std::filesystem::directory_iterator(scene))
      if (entry.is_regular_file() && (endings.contains(entry.path().extension().string()) || entry.path().string().ends_with(kHabitatEnd)))
        files.push_back(entry.path().string());
    if (files.empty())
      throw InputError(scene, "contains no .glb, .gltf, .obj, .ply, .stl, .scene_instance.json or .yaml file", "give a folder with scenes");
    std::ranges::sort(files);
    all.insert(all.end(), files.begin(), files.end());
  }
  for (const std::string& scene : all)
    if (!is_utf8(scene)) throw InputError(scene, "has a name that is not valid UTF-8, which the manifest needs", "rename the file");
  return all;
}

std::vector<CorpusRoomSpec> list_corpus_rooms(const RirCorpusConfig& config) {
  std::vector<CorpusRoomSpec> rooms;
  for (int i = 0; i < config.shoeboxes.count; ++i) rooms.push_back({shoebox_spec(config, static_cast<std::uint32_t>(i)), 0});
  const std::vector<std::string> scenes = expand_scenes(config.scenes);
  for (int again = 0; again < config.rooms_per_scene; ++again)
    for (const std::string& scene : scenes) rooms.push_back({.scene = scene, .is_first_of_scene = again == 0});
  for (std::size_t i = 0; i < rooms.size(); ++i) rooms[i].materials_seed = materials_seed_of(config.seed, static_cast<std::uint32_t>(i), 0);
  return rooms;
}

CorpusRoomSpec redraw_room(const RirCorpusConfig& config, std::size_t index, const CorpusRoomSpec& spec, std::uint32_t redraw) {
  CorpusRoomSpec again = spec;
  const auto room = static_cast<std::uint32_t>(index);
  if (room < static_cast<std::uint32_t>(config.shoeboxes.count)) again.scene = shoebox_spec(config, room, redraw);
  again.materials_seed = materials_seed_of(config.seed, room, redraw);
  again.is_first_of_scene = false;
  return again;
}

ListenerOrientation CorpusListener::orientation() const {
  // A level listener has a path of its own that keeps the bits of `earshot rir`.
  if (pitch_deg == 0 && roll_deg == 0) return {heading_deg * kDegree};
  return {heading_deg * kDegree, pitch_deg * kDegree, roll_deg * kDegree};
}

CorpusRoom::CorpusRoom(const RirCorpusConfig& config, std::size_t index, const CorpusRoomSpec& spec)
    : config_(config),
      index_(static_cast<std::uint32_t>(index)),
      acoustics_(load_room(config, spec), config.acoustics),
      navmesh_(acoustics_.scene().mesh(), floor_of(config)),
      pictures_(config.panorama ? std::make_unique<const CorpusPictures>(*config.panorama, acoustics_.scene()) : nullptr) {
  for (int source = 0; config.shared_listeners && source < config.sources_per_room; ++source)
    sources_.push_back(draw_source(source).sound.position);
}

bool CorpusRoom::is_free(glm::vec3 foot, float height_m) const { return stands_free(scene(), foot, height_m + config_.clearance_m); }

FreePlace CorpusRoom::draw_place(const RandomStream& random, std::uint32_t number, const std::vector<float>& height_m,
                                 const std::function<bool(glm::vec3)>& accept, const std::string& purpose) const {
  for (std::uint32_t attempt = 0; attempt < kTries; ++attempt) {
    const std::uint32_t draw = (number * kTries + attempt) * PlaceDraw::per_try;
    const FreePlace place{navmesh_.random_point(random, draw + PlaceDraw::foot),
                          within(height_m, random.uniform(draw + PlaceDraw::height))};
    if (accept(place.position()) && is_free(place.foot, place.height_m)) return place;
  }
  throw InputError(scene().name(), fmt::format("has no free position for {} in {} tries", purpose, kTries),
                   "widen the distances, lower the heights or clearance_m, or leave this scene out");
}

CorpusSource CorpusRoom::draw_source(int source) const {
  const RandomStream random = place_stream(config_.seed, index_, source, 0);
  for (std::uint32_t attempt = 0; attempt < kTries; ++attempt) {
    const std::uint32_t draw = attempt * PlaceDraw::per_try;
    const glm::vec3 foot = navmesh_.random_point(random, draw + PlaceDraw::foot);
    const float height_m = within(config_.source_height_m, random.uniform(draw + PlaceDraw::height));
    if (!is_free(foot, height_m)) continue;
    CorpusSource drawn{
        .sound = SoundSource(foot + glm::vec3(0, height_m, 0)),
        .pattern =
            config_.source_patterns[random.below(static_cast<std::uint32_t>(config_.source_patterns.size()), draw + PlaceDraw::pattern)],
        .heading_deg = heading_of(random, draw + PlaceDraw::heading)};
    drawn.sound.directivity = Directivity::named(drawn.pattern);
    drawn.sound.orientation = source_orientation(drawn.heading_deg);
    return drawn;
  }
  throw InputError(scene().name(), fmt::format("has no free position for a source in {} tries", kTries),
                   "lower source_height_m or clearance_m, or leave this scene out");
}

CorpusListener CorpusRoom::draw_listener(const CorpusSource& from, int source, int listener, std::uint32_t redraw) const {
  const RandomStream random = place_stream(config_.seed, index_, config_.shared_listeners ? kAnySource : source, listener + 1, redraw);
  for (std::uint32_t attempt = 0; attempt < kTries; ++attempt) {
    const std::uint32_t draw = attempt * PlaceDraw::per_try;
    const glm::vec3 foot = navmesh_.random_point(random, draw + PlaceDraw::foot);
    const float height_m = within(config_.listener_height_m, random.uniform(draw + PlaceDraw::height));
    const glm::vec3 place = foot + glm::vec3(0, height_m, 0);
    const auto in_range = [&](glm::vec3 position) {
      const float distance_m = glm::length(place - position);
      return distance_m >= config_.min_distance_m && distance_m <= config_.max_distance_m &&
             std::abs(place.y - position.y) <= config_.max_height_difference_m;
    };
    // With shared listeners the source itself is among the others.
    if (!in_range(from.sound.position) || !std::ranges::all_of(sources_, in_range) || !is_free(foot, height_m)) continue;
    return {.position = place,
            .heading_deg = heading_of(random, draw + PlaceDraw::heading),
            .pitch_deg = angle_within(config_.pitch_deg, random.uniform(draw + PlaceDraw::pitch)),
            .roll_deg = angle_within(config_.roll_deg, random.uniform(draw + PlaceDraw::roll)),
            .head = config_.hrtfs.empty() ? 0 : random.below(static_cast<std::uint32_t>(config_.hrtfs.size()), draw + PlaceDraw::head)};
  }
  throw InputError(scene().name(),
                   fmt::format("has no free position for a listener {} to {} m from a source in {} tries", config_.min_distance_m,
                               config_.max_distance_m, kTries),
                   "widen min_distance_m to max_distance_m, lower listener_height_m or clearance_m, or leave this scene out");
}

}  // namespace earshot
