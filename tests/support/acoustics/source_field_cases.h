// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "sim/acoustics/source_field/source_field.h"
#include "tests/support/acoustics/rooms.h"

/// Source fields of small rooms.
namespace earshot::source_fields {

/// Spends all `photons`: the error target is never met.
inline AcousticConfig field_config(int photons, float cell_m) {
  AcousticConfig config = rooms::plain_config();
  config.field_photons = photons;
  config.field_error = 1e-6f;
  config.field_cell_m = cell_m;
  config.rir_length_s = 1.f;
  return config;
}

/// One source in one room with its field.
struct Field {
  Field(const std::shared_ptr<const Scene>& room, const AcousticConfig& config, const SoundSource& source)
      : scene(room, config), candidates(scene, source), field(build_source_field(scene, candidates)) {}
  [[nodiscard]] EnergyHistogram at(glm::vec3 listener) const {
    EnergyHistogram histogram = make_histogram(scene);
    field->gather(scene, listener, histogram);
    return histogram;
  }
  AcousticScene scene;
  EarlyCandidates candidates;
  std::shared_ptr<const SourceField> field;
};

}  // namespace earshot::source_fields
