#include "sim/acoustics/accuracy/accuracy_trial.h"

#include <chrono>
#include <utility>
#include <vector>

namespace earshot {
namespace {

using Clock = std::chrono::steady_clock;
double ms_since(Clock::time_point begin) { return std::chrono::duration<double, std::milli>(Clock::now() - begin).count(); }

}  // namespace

AccuracyChoice try_config(const std::shared_ptr<const Scene>& scene, std::string method, const AcousticConfig& config,
                          const SoundSource& source, const AccuracyReference& reference, int seeds) {
  AccuracyChoice choice{.method = std::move(method), .config = config};
  std::vector<AcousticScene> scenes = {AcousticScene(scene, config)};
  const AcousticScene& first = scenes.front();
  if (uses_source_field(first)) static_cast<void>(first.field_grid());  // once per scene, not per source
  const auto begin = Clock::now();
  const EarlyCandidates candidates(first, source);
  const std::shared_ptr<const SourceField> field = uses_source_field(first) ? build_source_field(first, candidates) : nullptr;
  choice.per_source_ms = ms_since(begin);
  constexpr std::uint64_t apart = 1'000'003;
  for (int seed = 1; !field && seed < seeds; ++seed)
    scenes.push_back(scenes.front().with_rays(config.rays, config.seed + apart * static_cast<std::uint64_t>(seed)));
  try_responses(scenes, candidates, field.get(), reference, choice);
  return choice;
}

void try_responses(std::span<const AcousticScene> scenes, const EarlyCandidates& candidates, const SourceField* field,
                   const AccuracyReference& reference, AccuracyChoice& choice) {
  std::vector<AccuracyReading> readings;
  EnergyResponse response;
  double spent_ms = 0;
  for (const AcousticScene& acoustics : scenes)
    for (const glm::vec3 place : reference.places()) {
      const auto begin = Clock::now();
      compute_energy_response(acoustics, candidates, field, place, response);
      spent_ms += ms_since(begin);
      readings.push_back(read_accuracy(acoustics, response));
    }
  choice.per_pose_ms = spent_ms / static_cast<double>(readings.size());
  choice.measured = reference.errors_of(readings, 0);
  choice.predicted = reference.errors_of(readings, 1);
}

}  // namespace earshot
