// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "datasets/grid/grid_points.h"
#include "sim/acoustics/paths/early_reflections.h"
#include "sim/acoustics/response/place_check.h"
#include "sim/acoustics/source_field/source_field.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"

namespace earshot {

/// What all responses of a grid have in common.  All must outlive what renders them.
struct GridRendering {
  const AcousticScene& acoustics;
  const GridPoints& points;
  std::shared_ptr<const SynthesisTables> tables;
  /// Of each response of a pair, in the order of the files.
  std::vector<ListenerOrientation> orientations;
};

/// The responses of one source at the other points, and at its own: traced once for each listener, then rendered for each orientation.
/// Not thread-safe.
class GridSource {
 public:
  /// source: index of its point.  The late sound comes from field_for_poses for as many listeners as there are points.  synthesizer: of
  /// rendering.tables.
  GridSource(const GridRendering& rendering, RirSynthesizer& synthesizer, std::size_t source);
  /// Calls take(orientation, response) for each orientation, and returns the labels of the pair as a line of the manifest, without what
  /// take stores.  The response is that of `earshot rir` between the two points.  Throws InputError as place_check.h.
  nlohmann::ordered_json render(std::size_t receiver, const std::function<void(std::size_t orientation, const Rir& rir)>& take);

 private:
  const GridRendering& rendering_;
  RirSynthesizer& synthesizer_;
  std::size_t source_;
  EarlyCandidates candidates_;
  PlaceCheck places_;
  std::shared_ptr<const SourceField> field_;
  EnergyResponse response_;
  LateSound late_;
  Rir rir_;
};

}  // namespace earshot
