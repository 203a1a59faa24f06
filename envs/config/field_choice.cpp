// SPDX-License-Identifier: Apache-2.0
#include "envs/config/field_choice.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <string_view>
#include <utility>

#include "envs/config/env_accuracy.h"

namespace earshot {
namespace {

constexpr double kPhotonsAtUnitError = 1.8 * 1.8, kMinPhotons = 512;
constexpr double kRaysPerPhoton = 2.5, kRaysPerGather = 2.5;
constexpr double kNewPlacesPerStep = 0.4;
constexpr double kFieldGain = 2;

std::string why_unfit(const AcousticConfig& acoustics) {
  if (acoustics.late == Switch::off) return "late sound is off";
  if (acoustics.source_rays > 0) return "source_rays selects bidirectional tracing";
  if (acoustics.specular_exponent != 0.f) return "specular_exponent selects lobes";
  if (acoustics.rays == 0) return "rays = 0 gives no late sound";
  return {};
}

}  // namespace

FieldChoice choose_field(const AcousticConfig& acoustics, const EpisodeSet& set, double steps) {
  std::set<std::string_view> scenes;
  std::set<std::pair<std::string_view, std::array<double, 3>>> goals;
  double once = 0;
  for (const Episode& episode : set.episodes) {
    scenes.insert(episode.scene_id);
    goals.insert({episode.scene_id, {episode.goal_position.x, episode.goal_position.y, episode.goal_position.z}});
    once += std::max(episode.num_action, kStepsPerEpisode);
  }
  FieldChoice choice;
  choice.unfit = why_unfit(acoustics);
  choice.scenes = scenes.size();
  choice.goals = goals.size();
  choice.places_per_goal = kNewPlacesPerStep * (steps > 0 ? steps : once) / static_cast<double>(std::max<std::size_t>(goals.size(), 1));
  const double error = acoustics.field_error;
  choice.photons = std::min(std::max(kPhotonsAtUnitError / (error * error), kMinPhotons), static_cast<double>(acoustics.field_photons));
  choice.field_rays = kRaysPerPhoton * choice.photons + kRaysPerGather * choice.places_per_goal;
  choice.traced_rays = static_cast<double>(acoustics.rays) * choice.places_per_goal;
  choice.on = choice.unfit.empty() && choice.traced_rays > kFieldGain * choice.field_rays;
  return choice;
}

std::string FieldChoice::text() const {
  if (!unfit.empty()) return "off: " + unfit;
  return fmt::format(
      "{}: {} goals in {} scenes, {:.0f} listener positions per goal; {:.3g} rays per goal by tracing, {:.3g} with a field of {:.0f} "
      "photons",
      on ? "on" : "off", goals, scenes, places_per_goal, traced_rays, field_rays, photons);
}

}  // namespace earshot
