// SPDX-License-Identifier: Apache-2.0
#include "datasets/grid/grid_source.h"

#include <glm/geometric.hpp>
#include <nlohmann/json.hpp>

#include "datasets/labels/label_number.h"
#include "datasets/labels/response_labels.h"
#include "sim/acoustics/source_field/field_for_poses.h"
#include "sim/acoustics/synthesis/carriers.h"

namespace earshot {

GridSource::GridSource(const GridRendering& rendering, RirSynthesizer& synthesizer, std::size_t source)
    : rendering_(rendering),
      synthesizer_(synthesizer),
      source_(source),
      candidates_(rendering.acoustics, SoundSource(rendering.points.ears[source])),
      places_(rendering.acoustics),
      field_(field_for_poses(rendering.acoustics, candidates_, rendering.points.ears.size())) {}

nlohmann::ordered_json GridSource::render(std::size_t receiver, const std::function<void(std::size_t, const Rir&)>& take) {
  const AcousticScene& acoustics = rendering_.acoustics;
  const glm::vec3 from = rendering_.points.ears[source_], to = rendering_.points.ears[receiver];
  static_cast<void>(places_.check({"source", from}, {"listener", to}));
  compute_energy_response(acoustics, candidates_, field_.get(), to, response_);
  late_.forget();
  const CarrierKey key(carrier_key(acoustics.hash(), from), to);
  for (std::size_t i = 0; i < rendering_.orientations.size(); ++i) {
    synthesizer_.render(response_, rendering_.orientations[i], key, rir_, &late_);
    take(i, rir_);
  }
  nlohmann::ordered_json line{{"receiver", receiver}, {"source", source_}};
  line["distance_m"] = rounded(static_cast<double>(glm::length(from - to)));
  line["line_of_sight"] = is_in_sight(response_);
  line["direct_delay_s"] = rounded_delay(direct_delay_s(from, to, response_));
  add_metrics(acoustics, response_, field_.get(), line);
  line["num_samples"] = rir_.num_samples;
  return line;
}

}  // namespace earshot
