// SPDX-License-Identifier: Apache-2.0
#include "earshot/scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "api/convert.h"
#include "api/input_files.h"
#include "api/scene_model.h"
#include "api/source_model.h"
#include "envs/episodes/episode_generator.h"
#include "sim/acoustics/synthesis/channel_order.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "sim/base/text/config_reader.h"
#include "sim/nav/navmesh.h"
#include "sim/scene/checks/scene_check.h"

namespace earshot::api {
namespace {

SceneOverrides overrides_of(const SceneOptions& options) {
  if (!options.up.empty() && options.up != "y" && options.up != "z") throw InputError("up", "is '" + options.up + "'", "write y or z");
  SceneOverrides overrides;
  overrides.unit_m = options.unit_m;
  if (options.simplify_m) overrides.simplify_m = static_cast<float>(*options.simplify_m);
  if (!options.up.empty()) overrides.up = options.up == "z" ? MeshImportOptions::Up::z : MeshImportOptions::Up::y;
  overrides.cell_m = options.cell_m;
  return overrides;
}

}  // namespace

Scene::Model::Model(const std::string& spec, const SceneOptions& options)
    : config_(acoustic_preset(options.preset)), overrides_(overrides_of(options)) {
  ConfigReader reader = ConfigReader::from_text("", "settings", options.settings.texts());
  read(reader, config_);
  reader.finish();
  if (options.rate_hz) config_.sample_rate_hz = static_cast<float>(*options.rate_hz);
  if (options.seed) config_.seed = *options.seed;
  validate(config_);
  scene_ = std::make_shared<const earshot::Scene>(load_scene(spec, overrides_));
  warnings_ = scene_warnings(*scene_);
}

std::vector<std::string> Scene::Model::warnings() const {
  const std::lock_guard lock(mutex_);
  return warnings_;
}

void Scene::Model::add_warnings(const std::vector<std::string>& lines) {
  const std::lock_guard lock(mutex_);
  for (const std::string& line : lines)
    if (std::ranges::find(warnings_, line) == warnings_.end()) warnings_.push_back(line);
}

int Scene::Model::harmonics_of(const ListenerLayout& layout) const { return earshot::harmonics_of(layout, config_); }

std::shared_ptr<const AcousticScene> Scene::Model::acoustics(int sh_order) {
  return acoustics_.get(sh_order, [&] {
    AcousticConfig config = config_;
    config.sh_order = sh_order;
    return std::make_shared<const AcousticScene>(scene_, config);
  });
}

std::shared_ptr<const SynthesisTables> Scene::Model::tables(const std::string& channels, const std::string& hrtf) {
  const ListenerLayout layout = ListenerLayout::named(channels);
  if (!hrtf.empty() && layout.kind != ListenerKind::binaural)
    throw InputError("hrtf", fmt::format("has no effect on channels '{}'", channels), "leave it out, or ask for binaural");
  const std::string state = state_of_files(layout, hrtf);
  const auto make = [&] {
    std::shared_ptr<const Hrtf> head;
    if (layout.kind == ListenerKind::binaural)
      head = hrtf.empty() ? Hrtf::rigid_sphere(config_.sample_rate_hz) : Hrtf::from_sofa(hrtf, config_.sample_rate_hz);
    const ListenerLayout read_after_state = ListenerLayout::named(channels);
    const std::shared_ptr<const AcousticScene> scene = acoustics(harmonics_of(read_after_state));
    return std::make_shared<const TablesOfFiles>(
        TablesOfFiles{state, make_synthesis_tables(scene->config(), scene->bands(), read_after_state, head)});
  };
  for (;;) {
    const std::shared_ptr<const TablesOfFiles> kept = tables_.get({channels, hrtf}, make);
    if (kept->state == state) return kept->tables;
    tables_.drop({channels, hrtf}, kept);  // of files that have changed since
  }
}

std::shared_ptr<const Appearance> Scene::Model::appearance() {
  return appearance_.get(0, [&] { return load_appearance(*scene_, overrides_); });
}

Scene::Scene(const std::string& spec, const SceneOptions& options) : model_(std::make_shared<Model>(spec, options)) {}

const std::string& Scene::name() const { return model_->scene().name(); }
std::uint64_t Scene::hash() const { return model_->scene().hash(); }
std::size_t Scene::num_triangles() const { return model_->scene().mesh().triangles.size(); }
Bounds Scene::bounds() const {
  const auto& bounds = model_->scene().bounds();
  return {vec3_of(model_->scene().to_world(bounds.lower)), vec3_of(model_->scene().to_world(bounds.upper))};
}
double Scene::sample_rate_hz() const { return static_cast<double>(model_->config().sample_rate_hz); }
std::uint64_t Scene::seed() const { return model_->config().seed; }
double Scene::rir_length_s() const { return static_cast<double>(model_->acoustics()->config().rir_length_s); }
std::vector<double> Scene::bands_hz() const {
  const auto& centres = model_->acoustics()->bands().centre_hz;
  return {centres.begin(), centres.end()};
}
std::vector<std::string> Scene::warnings() const { return model_->warnings(); }

std::vector<EffectDecision> Scene::plan() const {
  std::vector<EffectDecision> plan;
  for (const earshot::EffectDecision& line : model_->acoustics()->plan().decisions)
    plan.push_back({line.effect, line.decision, line.on, line.change, line.unit, name_of(line.kind), line.saved_ms, line.why});
  return plan;
}

std::vector<Vec3> Scene::random_positions(int count, const PlaceOptions& options) const {
  require(count >= 0 && count <= 1'000'000, "count", count, "must be in [0, 1000000]");
  require(options.height_m > 0 && options.height_m <= 10, "height_m", options.height_m, "must be in (0, 10] m");
  constexpr std::uint32_t tries = 1000;
  const earshot::Scene& scene = model_->scene();
  const auto height = static_cast<float>(options.height_m);
  const Navmesh navmesh(scene.mesh(), NavmeshConfig{});
  std::vector<Vec3> positions;
  for (int i = 0; i < count; ++i) {
    if (options.stop.stop_requested()) throw RunError("random_positions", "was stopped by the caller");
    const RandomStream random(options.seed, Purpose::episode, static_cast<std::uint32_t>(i));
    bool found = false;
    for (std::uint32_t draw = 0; draw < tries && !found; ++draw) {
      const glm::vec3 foot = navmesh.random_point(random, 2 * draw);
      found = stands_free(scene, foot, height);
      if (found) positions.push_back(vec3_of(scene.to_world(foot + glm::vec3(0, height, 0))));
    }
    if (!found)
      throw InputError(scene.name(), fmt::format("has no free place of {} m height within {} draws", options.height_m, tries),
                       "lower height_m, or choose places by hand");
  }
  return positions;
}

std::vector<std::array<Vec3, 2>> Scene::section(double height_m) const {
  require(std::isfinite(height_m), "height_m", height_m, "must be finite");
  const earshot::Scene& scene = model_->scene();
  std::vector<std::array<Vec3, 2>> segments;
  for (const auto& triangle : scene.mesh().triangles) {
    std::array<glm::dvec3, 3> corners;
    for (glm::length_t i = 0; i < 3; ++i) corners[static_cast<std::size_t>(i)] = scene.to_world(scene.mesh().vertices[triangle[i]]);
    std::vector<glm::dvec3> ends;
    for (std::size_t i = 0; i < 3; ++i) {
      const glm::dvec3 &a = corners[i], &b = corners[(i + 1) % 3];
      // A corner in the plane counts as above it, so that two edges cross or none.
      if ((a.y < height_m) != (b.y < height_m)) ends.push_back(a + (b - a) * ((height_m - a.y) / (b.y - a.y)));
    }
    if (ends.size() == 2) segments.push_back({vec3_of(ends[0]), vec3_of(ends[1])});
  }
  return segments;
}

Source Scene::source(const Vec3& position, const SourceOptions& options) const {
  return Source(std::make_shared<Source::Model>(model_, position, options));
}

}  // namespace earshot::api
