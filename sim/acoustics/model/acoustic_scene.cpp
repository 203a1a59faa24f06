// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/acoustic_scene.h"

#include <tbb/task_arena.h>

#include <atomic>
#include <cstring>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include "sim/acoustics/geometry/field_grid.h"
#include "sim/acoustics/geometry/field_smoothing.h"
#include "sim/acoustics/model/air_absorption.h"
#include "sim/acoustics/model/plane_cells.h"
#include "sim/acoustics/model/reflection_model.h"
#include "sim/base/denormals.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

template <class T>
void append_bytes(std::string& bytes, T value) {
  char raw[sizeof(T)];
  std::memcpy(raw, &value, sizeof(T));
  bytes.append(raw, sizeof(T));
}

/// traced_transmission: by the plan, which a copy with other rays keeps.
std::uint64_t hash_of(const AcousticConfig& c, std::uint64_t scene_hash, bool traced_transmission) {
  std::string bytes;
  append_bytes(bytes, scene_hash);
  append_bytes(bytes, traced_transmission);
  for (const Switch s : {c.direct, c.early, c.late, c.air_absorption, c.diffraction, c.transmission, c.field}) {
    append_bytes(bytes, static_cast<std::int32_t>(s));
  }
  for (const int value :
       {c.early_order, c.early_candidate_rays, c.rays, c.max_bounces, c.sh_order, c.diffuse_last_segment ? 1 : 0, c.bands,
        c.diffraction_order, c.diffraction_paths, c.transmission_walls, c.source_rays, c.source_bounces, c.field_photons}) {
    append_bytes(bytes, value);
  }
  // Where nothing reads the radius any constant will do.
  const bool has_volume = !c.diffuse_last_segment || c.source_rays > 0 || c.specular_exponent != 0.f;
  for (const float value : {c.time_bin_s, c.rir_length_s, has_volume ? c.source_radius_m : 0.25f, c.scattering, c.sample_rate_hz,
                            c.diffraction_edge_m, c.specular_exponent, c.field_error, c.field_cell_m})
    append_bytes(bytes, value);
  append_bytes(bytes, c.seed);
  if (c.low_octave) append_bytes(bytes, c.low_octave);
  if (c.diffraction_reflections > 0) append_bytes(bytes, c.diffraction_reflections);
  // Others than the defaults, each behind a letter of its own.
  if (c.direct_rays != AcousticConfig{}.direct_rays) append_bytes(bytes, 'd'), append_bytes(bytes, c.direct_rays);
  if (c.wall_power != Switch::automatic) append_bytes(bytes, 'w'), append_bytes(bytes, static_cast<std::int32_t>(c.wall_power));
  return hash64(bytes);
}

/// With what was left to the plan filled in.
AcousticConfig effective_config(AcousticConfig config, const EffectPlan& plan) {
  config.rir_length_s = plan.rir_length_s;
  config.source_radius_m = plan.source_radius_m;
  if (!plan.late) config.late = Switch::off;
  return config;
}

}  // namespace

struct AcousticScene::LazyGrid {
  std::once_flag once;
  std::optional<FieldGrid> grid;
  std::optional<FieldSmoothing> smoothing;
  std::atomic<std::size_t> bytes{0};
  void build(const Scene& scene, float cell_m) {
    // While this thread waits for its own parallel work it must not take up a task that needs the grid too.
    std::call_once(once, [&] {
      tbb::this_task_arena::isolate([&] { smoothing.emplace(grid.emplace(scene, cell_m)); });
      bytes.store(grid->bytes() + smoothing->bytes(), std::memory_order_relaxed);
    });
  }
};

AcousticScene::AcousticScene(std::shared_ptr<const Scene> scene, const AcousticConfig& config)
    : AcousticScene(AcousticSurfaces(std::move(scene), config), nullptr) {}

AcousticScene::AcousticScene(AcousticSurfaces surfaces, EffectPlan plan)
    : AcousticScene(std::move(surfaces), std::make_shared<const EffectPlan>(std::move(plan))) {}

AcousticScene::AcousticScene(AcousticSurfaces surfaces, std::shared_ptr<const EffectPlan> plan)
    : surfaces_(std::move(surfaces)),
      plan_(plan ? std::move(plan) : std::make_shared<const EffectPlan>(plan_effects(surfaces_))),
      config_(effective_config(surfaces_.config(), *plan_)),
      field_grid_(std::make_shared<LazyGrid>()),
      plane_cells_(std::make_shared<const PlaneCells>()) {
  const FlushDenormals flush;
  for (int band = 0; band < num_bands(); ++band) {
    if (!plan_->air[band]) continue;
    air_.curve = air_curve(this->scene().air());
    air_.band_per_m[band] = static_cast<float>(air_absorption_energy_per_m(this->scene().air(), bands().centre_hz[band]));
  }
  reflection_model_ = std::make_shared<const ReflectionModel>(surfaces_, plan_->traced_transmission);
  if (plan_->wall_power) wall_power_ = std::make_shared<const WallPower>(surfaces_, config_.wall_power == Switch::on);
  hash_ = hash_of(config_, this->scene().hash(), plan_->traced_transmission);
}

std::size_t AcousticScene::bytes() const {
  return sizeof(AcousticScene) + surfaces_.bytes() + plane_cells_->bytes() + field_grid_->bytes.load(std::memory_order_relaxed) +
         (wall_power_ ? wall_power_->bytes() : 0) + plan_->decisions.capacity() * sizeof(EffectDecision);
}

const FieldGrid& AcousticScene::field_grid() const {
  field_grid_->build(scene(), config_.field_cell_m);
  return *field_grid_->grid;
}

const FieldSmoothing& AcousticScene::field_smoothing() const {
  field_grid_->build(scene(), config_.field_cell_m);
  return *field_grid_->smoothing;
}

AcousticScene AcousticScene::with_rays(int rays, std::uint64_t seed) const {
  AcousticScene copy = *this;
  copy.config_.rays = rays;
  copy.config_.seed = seed;
  validate(copy.config_);
  copy.hash_ = hash_of(copy.config_, scene().hash(), copy.plan_->traced_transmission);
  return copy;
}

}  // namespace earshot
