// SPDX-License-Identifier: Apache-2.0
#include "evaluation/replay/replay_page.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "evaluation/replay/base64.h"
#include "evaluation/replay/replay_scene.h"
#include "sim/audio/dry_sounds/flac_bytes.h"
#include "sim/base/text/json.h"
#include "sim/base/text/markup.h"
#include "sim/vision/jpeg_bytes.h"

namespace earshot {
namespace {

using Json = nlohmann::ordered_json;

constexpr const char* kPage =
#include "replay_page_html.inc"
    ;
constexpr const char* kStyle =
#include "replay_page_css.inc"
    ;
constexpr const char* kScript =
#include "replay_page_js.inc"
    ;
/// Empty where the build found no three.js.
constexpr const char* kThree =
#include "replay_page_three.inc"
    ;

constexpr int kMapQuality = 92;
constexpr float kLoudest = 0.89f;  ///< of the sound of a page: 1 dB below the largest number

double degrees(double rad) { return rad * 180.0 / std::numbers::pi; }
double rounded(double value, double unit) { return std::round(value / unit) * unit; }
/// A number of a page, with significant digits only; null if it is not finite.
Json number(double value, double per_unit = 1e4) { return std::isfinite(value) ? Json(std::round(value * per_unit) / per_unit) : Json(); }
Json place(glm::vec3 at) { return {number(at.x, 1e3), number(at.y, 1e3), number(at.z, 1e3)}; }
Json places(const std::vector<glm::vec3>& all) {
  Json list = Json::array();
  for (const glm::vec3 at : all) list.push_back(place(at));
  return list;
}

Json mesh_json(const EpisodeRecording& recording, float floor_m) {
  const ReplayMesh mesh = replay_mesh(*recording.scene->scene, *recording.looks, floor_m);
  glm::vec3 low(0), high(1);
  if (!mesh.vertices.empty()) low = high = mesh.vertices[0];
  for (const glm::vec3 vertex : mesh.vertices) {
    low = glm::min(low, vertex);
    high = glm::max(high, vertex);
  }
  const glm::vec3 size = glm::max(high - low, glm::vec3(1e-3f));
  std::vector<std::uint16_t> corners;  // 65535 steps over a house: a tenth of a millimetre
  for (const glm::vec3 vertex : mesh.vertices)
    for (int axis = 0; axis < 3; ++axis)
      corners.push_back(static_cast<std::uint16_t>(std::lround(65535.f * (vertex[axis] - low[axis]) / size[axis])));
  std::vector<std::uint32_t> indices;
  for (const glm::uvec3 triangle : mesh.triangles) indices.insert(indices.end(), {triangle.x, triangle.y, triangle.z});
  return {{"low", place(low)},
          {"size", place(size)},
          {"vertices", base64_of<std::uint16_t>(corners)},
          {"triangles", base64_of<std::uint32_t>(indices)},
          {"colors", base64_of<std::uint8_t>(mesh.colors)}};
}

Json map_json(const EpisodeRecording& recording, float floor_m) {
  const ReplayMap map = replay_map(*recording.scene, *recording.looks, floor_m);
  return {{"width_px", map.width_px},
          {"height_px", map.height_px},
          {"low", {number(map.low.x), number(map.low.y)}},
          {"metres_per_px", map.metres_per_px},
          {"picture", base64(jpeg_bytes(map.width_px, map.height_px, map.rgb, kMapQuality))}};
}

std::string depth_jpeg(const EnvConfig& env, const std::vector<float>& depth) {
  std::vector<std::uint8_t> grey(depth.size());
  std::ranges::transform(depth, grey.begin(),
                         [](float value) { return static_cast<std::uint8_t>(std::lround(255.f * std::clamp(value, 0.f, 1.f))); });
  return jpeg_bytes(env.observation.camera.width_px, env.observation.camera.height_px, grey, kPictureQuality);
}

Json pictures_json(const EpisodeRecording& recording) {
  Json colors = Json::array(), depths = Json::array();
  for (const RecordedStep& step : recording.steps) {
    colors.push_back(base64(jpeg_bytes(recording.config.width_px, recording.config.height_px, step.rgb, kPictureQuality)));
    if (!step.depth.empty()) depths.push_back(base64(depth_jpeg(recording.env, step.depth)));
  }
  return {{"width_px", recording.config.width_px},
          {"height_px", recording.config.height_px},
          {"rgb", std::move(colors)},
          {"depth", std::move(depths)},
          {"max_depth_m", recording.env.observation.camera.max_depth_m}};
}

Json sound_json(const EpisodeRecording& recording) {
  float peak = 0;
  for (const float value : recording.sound) peak = std::max(peak, std::fabs(value));
  const float gain = peak > 0 ? kLoudest / peak : 1.f;
  std::vector<float> sound(recording.sound);
  for (float& value : sound) value *= gain;
  const float rate_hz = recording.env.acoustics.sample_rate_hz;
  return {{"mime", "audio/flac"},
          {"sample_rate_hz", rate_hz},
          {"samples", sound.size() / 2},
          {"gain_db", number(20 * std::log10(static_cast<double>(gain)), 100)},
          {"data", base64(flac_bytes(sound, 2, rate_hz))}};
}

Json steps_json(const EpisodeRecording& recording) {
  Json steps = Json::array();
  for (std::size_t i = 0; i < recording.steps.size(); ++i) {
    const RecordedStep& step = recording.steps[i];
    Json entry{{"position", place(step.pose.position)},
               {"heading_deg", number(degrees(step.pose.heading_rad), 100)},
               {"reward", number(step.reward)},
               {"collided", step.collided},
               {"walk_m", number(step.walk_m, 1e3)},
               {"straight_m", number(step.straight_m, 1e3)},
               {"bearing_deg", number(degrees(step.bearing_rad), 10)},
               {"level_db", {number(step.level_db[0], 10), number(step.level_db[1], 10)}},
               {"heard_deg", step.heard_rad ? number(degrees(*step.heard_rad), 10) : Json()}};
    if (i > 0) entry["action"] = recording.actions[i - 1];
    if (step.judgement) {
      entry["value"] = number(step.judgement->value);
      entry["probabilities"] = Json::array();
      for (const double probability : step.judgement->probabilities) entry["probabilities"].push_back(number(probability));
    }
    steps.push_back(std::move(entry));
  }
  return steps;
}

/// Where each sound is: once where it stays, else by step; and the first and the last observation that it plays in.
Json sources_json(const EpisodeRecording& recording) {
  Json sources = Json::array();
  const std::size_t count = recording.steps.front().sources.size();
  for (std::size_t i = 0; i < count; ++i) {
    std::vector<glm::vec3> path;
    for (const RecordedStep& step : recording.steps) path.push_back(step.sources[i]);
    if (std::ranges::adjacent_find(path, std::not_equal_to<>()) == path.end()) path.resize(1);
    const bool listed = !recording.episode.sources.empty();
    sources.push_back({{"sound", listed ? recording.episode.sources[i].sound : recording.episode.sound},
                       {"goal", !listed || recording.episode.sources[i].goal},
                       {"playing", recording.playing[i] ? Json(*recording.playing[i]) : Json()},
                       {"places", places(path)}});
  }
  return sources;
}

void replace(std::string& text, std::string_view key, std::string_view replacement) {
  const std::size_t at = text.find(key);
  if (at != std::string::npos) text.replace(at, key.size(), replacement);
}

}  // namespace

bool replay_has_three() { return *kThree != '\0'; }

std::string replay_json(const EpisodeRecording& recording, const ReplayCaption& caption) {
  const float floor_m = recording.steps.front().pose.position.y;
  const EpisodeMetrics& metrics = recording.metrics;
  Json links = Json::array();
  for (const auto& [address, text] : caption.links) links.push_back({{"href", address}, {"text", text}});
  const Json json{{"schema_version", 1},
                  {"agent", caption.agent},
                  {"policy", caption.policy},
                  {"set_hash", caption.set_hash},
                  {"engine_hash", caption.engine_hash},
                  {"links", std::move(links)},
                  {"episode",
                   {{"index", recording.index},
                    {"id", recording.episode.episode_id},
                    {"scene", recording.episode.scene_id},
                    {"sound", recording.episode.sound}}},
                  {"metrics",
                   {{"success", metrics.success},
                    {"spl", number(metrics.spl)},
                    {"soft_spl", number(metrics.soft_spl)},
                    {"sna", number(metrics.sna)},
                    {"success_when_silent", metrics.success_when_silent},
                    {"dtg_m", number(metrics.dtg_m)},
                    {"reward", number(metrics.reward)},
                    {"steps", metrics.steps},
                    {"collisions", metrics.collisions},
                    {"stopped", metrics.stopped}}},
                  {"step_time_s", rounded(static_cast<double>(recording.env.task.step_time_s), 1e-6)},
                  {"samples_per_step", recording.samples_per_step},
                  {"success_radius_m", recording.env.task.success_radius_m},
                  {"camera_height_m", recording.env.observation.camera.height_m},
                  {"source_height_m", recording.env.task.source_height_m},
                  {"fov_deg", recording.env.observation.camera.horizontal_fov_deg},
                  {"floor_m", floor_m},
                  {"goals", places(recording.goals)},
                  {"sources", sources_json(recording)},
                  {"oracle", {{"actions", recording.oracle_actions}, {"places", places(recording.oracle)}}},
                  {"steps", steps_json(recording)},
                  {"mesh", mesh_json(recording, floor_m)},
                  {"map", map_json(recording, floor_m)},
                  {"pictures", pictures_json(recording)},
                  {"audio", sound_json(recording)}};
  return json_text(json);
}

std::string replay_html(const EpisodeRecording& recording, const ReplayCaption& caption) {
  std::string json = replay_json(recording, caption);  // base64 has no '<'; the name of a scene may
  for (std::size_t at = json.find('<'); at != std::string::npos; at = json.find('<', at)) json.replace(at, 1, "\\u003c");
  std::string page = kPage;
  replace(page, "@TITLE@", escape_markup(fmt::format("{}: episode {} in {}", caption.agent, recording.index, recording.episode.scene_id)));
  replace(page, "@STYLE@", kStyle);
  replace(page, "@THREE@", kThree);
  replace(page, "@SCRIPT@", kScript);
  replace(page, "@EPISODE@", json);
  return page;
}

}  // namespace earshot
