// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/accuracy/accuracy_trial.h"

#include <cmath>
#include <utility>
#include <vector>

namespace earshot {

double spent_ms(const Stopwatch& watch, const AcousticConfig& config) {
  return config.threads == 1 ? 1e3 * watch.cpu_s() : watch.wall_ms();
}

AccuracyChoice try_config(const std::shared_ptr<const Scene>& scene, std::string method, const AcousticConfig& config,
                          const SoundSource& source, const AccuracyReference& reference, int seeds) {
  AccuracyChoice choice{.method = std::move(method), .config = config};
  std::vector<AcousticScene> scenes = {AcousticScene(scene, config)};
  const AcousticScene& first = scenes.front();
  if (uses_source_field(first)) static_cast<void>(first.field_grid());  // once per scene, not per source
  const Stopwatch watch;
  const EarlyCandidates candidates(first, source);
  const std::shared_ptr<const SourceField> field = uses_source_field(first) ? build_source_field(first, candidates) : nullptr;
  choice.per_source_ms = spent_ms(watch, config);
  constexpr std::uint64_t apart = 1'000'003;
  for (int seed = 1; !field && seed < seeds; ++seed)
    scenes.push_back(scenes.front().with_rays(config.rays, config.seed + apart * static_cast<std::uint64_t>(seed)));
  try_responses(scenes, candidates, field.get(), reference, choice);
  return choice;
}

AccuracyChoice worst_of(std::span<const AccuracyChoice> at_sites) {
  AccuracyChoice worst = at_sites.front();
  const auto count = static_cast<double>(at_sites.size());
  worst.per_source_ms = worst.per_pose_ms = 0;
  for (const AccuracyChoice& choice : at_sites) {
    for (std::size_t kind = 0; kind < kNumAccuracyKinds; ++kind) {
      // A kind without a value at a site (NaN) is decided at the other sites.
      worst.measured[kind] = std::fmax(worst.measured[kind], choice.measured[kind]);
      worst.predicted[kind] = std::fmax(worst.predicted[kind], choice.predicted[kind]);
    }
    worst.per_source_ms += choice.per_source_ms / count;
    worst.per_pose_ms += choice.per_pose_ms / count;
  }
  return worst;
}

void try_responses(std::span<const AcousticScene> scenes, const EarlyCandidates& candidates, const SourceField* field,
                   const AccuracyReference& reference, AccuracyChoice& choice) {
  std::vector<AccuracyReading> readings;
  EnergyResponse response;
  double all_ms = 0;
  for (const AcousticScene& acoustics : scenes)
    for (const glm::vec3 place : reference.places()) {
      const Stopwatch watch;
      compute_energy_response(acoustics, candidates, field, place, response);
      all_ms += spent_ms(watch, choice.config);
      readings.push_back(read_accuracy(acoustics, response));
    }
  choice.per_pose_ms = all_ms / static_cast<double>(readings.size());
  choice.measured = reference.errors_of(readings, 0);
  choice.predicted = reference.errors_of(readings, 1);
}

}  // namespace earshot
