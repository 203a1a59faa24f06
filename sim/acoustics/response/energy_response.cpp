// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/response/energy_response.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <span>

#include "sim/acoustics/paths/transmission.h"
#include "sim/acoustics/response/scattered_energy.h"
#include "sim/acoustics/response/sphere_arrivals.h"
#include "sim/acoustics/source_field/source_field.h"
#include "sim/base/coordinates.h"
#include "sim/base/denormals.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

void apply_emission(const Emission& emission, std::size_t num_bands, std::span<Arrival> arrivals) {
  if (emission.omnidirectional()) return;
  std::array<float, kMaxBands> gain;
  for (Arrival& arrival : arrivals) {
    emission.pressure(arrival.departure, std::span(gain).first(num_bands));
    for (std::size_t band = 0; band < num_bands; ++band) {
      arrival.amplitude[band] *= std::fabs(gain[band]);
      if (gain[band] < 0) arrival.phase_rad[band] += std::numbers::pi_v<float>;
    }
  }
}

/// Late energy of a source and a listener near walls (wall_power.h).
void raise_near_walls(const AcousticScene& scene, const EarlyCandidates& candidates, glm::vec3 listener, EnergyResponse& response) {
  response.wall_gain = {};
  if (!scene.plan().wall_power) return;
  response.wall_gain = scene.wall_gain(listener) * candidates.wall_gain();
  if (!response.wall_gain.any) return;
  response.late.scale(response.wall_gain.energy);
  response.batches.scale(response.wall_gain.energy);
  for (Arrival& arrival : response.scattered)
    for (std::size_t band = 0; band < static_cast<std::size_t>(scene.num_bands()); ++band)
      arrival.amplitude[band] *= std::sqrt(response.wall_gain.energy[band]);
}

/// Has the size of a panel changed an image, in energy or phase?
bool panels_matter(const EnergyResponse& response) {
  return !response.scattered.empty() || std::ranges::any_of(response.arrivals, [](const Arrival& arrival) {
    return arrival.kind == ArrivalKind::reflection && std::ranges::any_of(arrival.phase_rad, [](float phase) { return phase != 0.f; });
  });
}

/// All arrivals, without the source's emission.  Returns what was found.
PoseEffects find_paths_of_point(const AcousticScene& scene, const EarlyCandidates& candidates, glm::vec3 listener,
                                EnergyResponse& response) {
  PoseEffects effects = decide_pose_effects(scene, candidates, listener);
  candidates.find_arrivals(scene, listener, effects.in_sight, response.arrivals, &response.scattered);
  if (effects.diffraction) {
    const bool panels = panels_matter(response);
    effects.diffraction = candidates.diffraction().find_arrivals(scene, listener, effects.in_sight, response.arrivals) > 0 || panels;
  }
  if (effects.transmission) find_transmitted_behind_walls(scene, candidates.source(), listener, response.arrivals);
  return effects;
}
PoseEffects find_paths_of_sphere(const AcousticScene& scene, const EarlyCandidates& candidates, glm::vec3 listener,
                                 EnergyResponse& response) {
  candidates.find_arrivals(scene, listener, false, response.arrivals, &response.scattered);
  const bool panels = panels_matter(response);
  PoseEffects effects = find_sphere_arrivals(scene, candidates, listener, response.arrivals);
  if (effects.in_sight) {
    candidates.find_panel_waves(scene, listener, false, response.arrivals, &response.scattered);
    std::ranges::stable_sort(response.arrivals, {}, &Arrival::distance_m);
  }
  effects.diffraction = effects.diffraction || (panels && candidates.diffraction().size() > 0);
  return effects;
}

}  // namespace

void compute_energy_response(const AcousticScene& scene, const EarlyCandidates& candidates, glm::vec3 listener, EnergyResponse& response,
                             const std::function<void(double fraction)>& progress) {
  compute_energy_response(scene, candidates, nullptr, listener, response, progress);
}

void compute_energy_response(const AcousticScene& scene, const EarlyCandidates& candidates, const SourceField* field, glm::vec3 listener,
                             EnergyResponse& response, const std::function<void(double fraction)>& progress) {
  const FlushDenormals flush;
  if (!is_valid_position(listener))
    throw InputError(fmt::format("listener ({}, {}, {}) in {}", listener.x, listener.y, listener.z, scene.scene().name()),
                     "is not a valid position in a scene", "give three finite numbers in metres");
  response.speed_of_sound_m_per_s = scene.speed_of_sound_m_per_s();
  response.air = scene.air_loss();
  response.arrivals.clear();
  response.scattered.clear();
  const PoseEffects effects = is_sphere(scene, candidates.sound_source(), listener)
                                  ? find_paths_of_sphere(scene, candidates, listener, response)
                                  : find_paths_of_point(scene, candidates, listener, response);
  apply_emission(candidates.emission(), static_cast<std::size_t>(scene.num_bands()), response.arrivals);
  apply_emission(candidates.emission(), static_cast<std::size_t>(scene.num_bands()), response.scattered);
  const std::uint64_t nonfinite_arrivals = drop_nonfinite(static_cast<std::size_t>(scene.num_bands()), response.arrivals) +
                                           drop_nonfinite(static_cast<std::size_t>(scene.num_bands()), response.scattered);
  if (!has_shape_of(scene, response.late)) response.late = make_histogram(scene);
  if (field != nullptr) {
    response.batches.clear();
    response.stats = field->gather(scene, listener, response.late);
  } else if (scene.config().source_rays > 0 || scene.config().specular_exponent != 0.f) {
    response.stats =
        trace_bidirectional(scene, candidates, listener, response.late, &response.batches, BidirectionalOptions{.progress = progress});
  } else {
    response.batches.clear();
    response.stats = trace_late(scene, candidates, listener, response.late, &response.memory.paths());
  }
  response.stats.nonfinite_dropped += nonfinite_arrivals;
  raise_near_walls(scene, candidates, listener, response);
  if (scene.config().late != Switch::off && response.late.num_bins() > 0)
    add_scattered_energy(response.scattered, response.speed_of_sound_m_per_s, response.late);
  response.effects = count_effects(scene, effects, field != nullptr);
}

}  // namespace earshot
