// SPDX-License-Identifier: Apache-2.0
#include "compat/pair_renderer.h"

#include <algorithm>
#include <cmath>

#include "sim/acoustics/synthesis/carriers.h"
#include "sim/audio/head/hrtf.h"

namespace earshot::compat {
namespace {

RirSynthesizer& synthesizer_of(const AcousticScene& acoustics, PlacedListener& listener) {
  const AcousticConfig& config = acoustics.config();
  if (listener.synthesizer && listener.rir_length_s == config.rir_length_s) return *listener.synthesizer;
  std::shared_ptr<const Hrtf> head = listener.hrtf;
  if (listener.layout.kind == ListenerKind::binaural && !head) head = Hrtf::rigid_sphere(config.sample_rate_hz);
  listener.synthesizer =
      std::make_shared<RirSynthesizer>(make_synthesis_tables(config, acoustics.bands(), listener.layout, std::move(head)));
  listener.rir_length_s = config.rir_length_s;
  return *listener.synthesizer;
}

bool has_sound(const EnergyResponse& response) {
  return !response.arrivals.empty() || !std::ranges::all_of(response.late.values(), [](float energy) { return energy == 0.f; });
}

}  // namespace

ListenerOrientation listener_orientation(const PlacedListener& listener, const ContextSettings& settings) {
  glm::dquat orientation = listener.orientation;
  if (listener.layout.kind == ListenerKind::binaural && settings.hrtf_to_listener) orientation = orientation * *settings.hrtf_to_listener;
  // A level listener takes the path that keeps the bits of `earshot rir`.
  if (orientation.x == 0 && orientation.z == 0) return {2 * std::atan2(orientation.y, orientation.w)};
  return ListenerOrientation(orientation);
}

PairResponse PairRenderer::render(const std::shared_ptr<const AcousticScene>& acoustics, const ContextSettings& settings,
                                  PlacedSource& source, PlacedListener& listener, std::pair<std::size_t, std::size_t> listener_and_source,
                                  std::size_t num_listeners) {
  const Scene& scene = acoustics->scene();
  auto& [candidates, field] = source.paths[acoustics->config().sh_order];
  if (!candidates) {
    SoundSource sound(scene.to_local(source.position));
    sound.radius_m = source.radius_m;
    candidates = std::make_shared<const EarlyCandidates>(*acoustics, sound);
  }
  const glm::vec3 place = scene.to_local(listener.position);
  if (settings.has_temporal_coherence) {
    trajectories_[listener_and_source].compute(*acoustics, *candidates, place, response_);
  } else {
    const bool wants_field = wants_source_field(*acoustics, num_listeners);
    if (wants_field && !field) field = field_for_poses(*acoustics, *candidates, num_listeners);
    compute_energy_response(*acoustics, *candidates, wants_field ? field.get() : nullptr, place, response_);
  }
  PairResponse pair;
  const CarrierKey key(carrier_key(acoustics->hash(), candidates->source()), place);
  synthesizer_of(*acoustics, listener).render(response_, listener_orientation(listener, settings), key, pair.rir);
  for (float& sample : pair.rir.samples) sample *= settings.gain;
  pair.metrics = measure(*acoustics, response_);
  pair.ray_efficiency = response_.stats.ray_efficiency();
  pair.is_silent = !has_sound(response_);
  pair.num_not_finite = response_.stats.nonfinite_dropped;
  return pair;
}

}  // namespace earshot::compat
