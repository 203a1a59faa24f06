#include "sim/acoustics/model/acoustic_scene.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <cstring>
#include <glm/geometric.hpp>
#include <mutex>
#include <optional>
#include <string>

#include "sim/acoustics/geometry/diffraction_edges.h"
#include "sim/acoustics/geometry/field_grid.h"
#include "sim/acoustics/geometry/field_smoothing.h"
#include "sim/acoustics/model/air_absorption.h"
#include "sim/acoustics/model/effect_plan.h"
#include "sim/acoustics/model/reflection_model.h"
#include "sim/acoustics/model/specular_lobe.h"
#include "sim/base/denormals.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

template <class T>
void append_bytes(std::string& bytes, T value) {
  char raw[sizeof(T)];
  std::memcpy(raw, &value, sizeof(T));
  bytes.append(raw, sizeof(T));
}

/// traced_transmission: what the plan made of the config, which a copy with other rays keeps.
std::uint64_t hash_of(const AcousticConfig& c, std::uint64_t scene_hash, bool traced_transmission) {
  std::string bytes;
  append_bytes(bytes, scene_hash);
  append_bytes(bytes, traced_transmission);
  for (const Switch s : {c.direct, c.early, c.late, c.air_absorption, c.diffraction, c.transmission, c.field}) {
    append_bytes(bytes, static_cast<std::int32_t>(s));
  }
  for (const int value :
       {c.early_order, c.early_candidate_rays, c.rays, c.max_bounces, c.sh_order, c.diffuse_last_leg ? 1 : 0, c.bands, c.diffraction_order,
        c.diffraction_paths, c.transmission_walls, c.source_rays, c.source_bounces, c.field_photons}) {
    append_bytes(bytes, value);
  }
  for (const float value : {c.time_bin_s, c.rir_length_s, c.source_radius_m, c.scattering, c.sample_rate_hz, c.diffraction_edge_m,
                            c.specular_exponent, c.field_error, c.field_cell_m})
    append_bytes(bytes, value);
  append_bytes(bytes, c.seed);
  return hash64(bytes);
}

}  // namespace

struct AcousticScene::LazyGrid {
  std::once_flag once;
  std::optional<FieldGrid> grid;
  std::optional<FieldSmoothing> smoothing;
  void build(const Scene& scene, float cell_m) {
    // While this thread waits for its own parallel work it must not take up a task that asks for the grid again.
    std::call_once(once, [&] { tbb::this_task_arena::isolate([&] { smoothing.emplace(grid.emplace(scene, cell_m)); }); });
  }
};

AcousticScene::AcousticScene(std::shared_ptr<const Scene> scene, const AcousticConfig& config) : scene_(std::move(scene)), config_(config) {
  const FlushDenormals flush;
  validate(config_);
  bands_ = config_.bands > 0 ? BandLayout::log_spaced(config_.bands, config_.sample_rate_hz) : BandLayout::octaves(config_.sample_rate_hz);
  stride_ = (num_bands() + 7) / 8 * 8;

  const std::vector<Material>& materials = scene_->materials();
  const std::size_t size = materials.size() * static_cast<std::size_t>(stride_);
  reflectance_.assign(size, 0.f);
  scattering_.assign(size, 0.f);
  transmission_.assign(size, 0.f);
  damping_.assign(size, 0.f);
  for (std::size_t slot = 0; slot < materials.size(); ++slot) {
    const Material& material = materials[slot];
    for (int band = 0; band < num_bands(); ++band) {
      const float low_hz = bands_.edge_hz[band], high_hz = bands_.edge_hz[band + 1];
      const auto mean = [&](const CoefficientCurve& curve) { return std::clamp(curve.band_mean(low_hz, high_hz), 0.f, 1.f); };
      const std::size_t cell = slot * stride_ + band;
      reflectance_[cell] = 1.f - mean(material.absorption);
      scattering_[cell] = config_.scattering >= 0.f ? config_.scattering : mean(material.scattering);
      // What passes through is part of what is not reflected (docs/oracles.md, O-22; docs/stability.md, H-27).
      transmission_[cell] = std::min(mean(material.transmission), 1.f - reflectance_[cell]);
      transmits_ = transmits_ || transmission_[cell] > 0.f;
      damping_[cell] = std::max(material.damping_db_per_m.band_mean(low_hz, high_hz), 0.f);
    }
  }

  if (config_.specular_exponent > 0.f) specular_lobe_ = std::make_shared<const SpecularLobe>(config_.specular_exponent);
  if (config_.diffraction != Switch::off)
    diffraction_edges_ = std::make_shared<const DiffractionEdges>(*scene_, config_.diffraction_edge_m);
  field_grid_ = std::make_shared<LazyGrid>();
  planes_ = find_mirror_planes(scene_->mesh());
  if (!scene_->mesh().triangles.empty()) diagonal_m_ = glm::length(scene_->bounds().upper - scene_->bounds().lower);

  plan_ = std::make_shared<const EffectPlan>(plan_effects(*this));
  config_.rir_length_s = plan_->rir_length_s;
  if (!plan_->late) config_.late = Switch::off;
  image_order_ = plan_->image_order;
  air_.assign(num_bands(), 0.f);
  for (int band = 0; band < num_bands(); ++band) {
    if (plan_->air[band]) air_[band] = static_cast<float>(air_absorption_energy_per_m(scene_->air(), bands_.centre_hz[band]));
  }
  reflection_model_ = std::make_shared<const ReflectionModel>(*this, traces_transmission(*this));
  hash_ = hash_of(config_, scene_->hash(), plan_->traced_transmission);
}

const FieldGrid& AcousticScene::field_grid() const {
  field_grid_->build(*scene_, config_.field_cell_m);
  return *field_grid_->grid;
}

const FieldSmoothing& AcousticScene::field_smoothing() const {
  field_grid_->build(*scene_, config_.field_cell_m);
  return *field_grid_->smoothing;
}

AcousticScene AcousticScene::with_rays(int rays, std::uint64_t seed) const {
  AcousticScene copy = *this;
  copy.config_.rays = rays;
  copy.config_.seed = seed;
  validate(copy.config_);
  copy.hash_ = hash_of(copy.config_, scene_->hash(), copy.plan_->traced_transmission);
  return copy;
}

}  // namespace earshot
