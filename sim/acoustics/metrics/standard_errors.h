// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/paths/early_reflections.h"

namespace earshot {

class SourceField;

/// Standard errors of parameters, each in the field of the parameter itself and in its unit; nullopt where it is not known.  Twice an error
/// covers 95 % of seeds.
struct MetricErrors {
  /// Of the energy response: of rt60_s, of the statistics in kErrorEntries, and of what was asked for.  Empty with too few rays and without
  /// a late field.
  std::vector<BandMetrics> bands;
  std::vector<BandMetrics> ears;  ///< octaves of the rendered ears: iacc, iacc_early, iacc_late; empty where not asked for
  std::optional<double> sti;
};

/// Between the keys of sets of carriers.
inline constexpr std::uint64_t kCarrierStep = 0x9E3779B97F4A7C15ull;
/// Renders both ears of a response; carriers: number of the noise that its late field rides on, 0 as in the response itself.
using RenderEars = std::function<void(const EnergyResponse& response, std::uint64_t carriers, Rir& ears)>;

/// From the batches of a bidirectional response (late_errors.h); otherwise by repetition: eight traces with an eighth of the rays and seeds
/// of their own, whose mean spreads as one trace with all rays; for the parameters of every response the lesser of the spread of their
/// values and of the jackknife over their late fields, as both overstate where a parameter is no smooth function of the energies.  A trace
/// from the listener does not have eight independent parts: up to 256 rays are weighed against each other (population_control.h), which
/// leaves four such populations of the preset `balanced`, and all rays follow one sequence of directions (SphereSequence).
/// No such repetition shows what all few rays miss, as in a long corridor, nor a bias: presets but `high` take the last segment as diffuse
/// (AcousticConfig::diffuse_last_segment).  So 0.6 of what a parameter differs from that of a better response joins the error as root of
/// the sum of squares: from 2048 rays or more, without that bias where source and listener see each other or walls let nothing through;
/// between facing mirrors (facing_planes.h), and where walls scatter less than a tenth, from a source field.
/// With the late field gathered from `field`: the spread of its photons at the listener (field_batches), in quadrature with what cells of
/// half the size change for the same photons (0.05 m at least; cells of that size have no such part).  SourceField::t20_error is a mean
/// over places. The parameters of `request` are by repetition, of a bidirectional trace eight times with all of its rays; with a field they
/// have no error.  render_ears: with request.interaural, null where there are no ears: IACC also has the noise of its carriers, found from
/// eight others under the same response. Cost: the metrics of one response per batch and octave of time, or one more trace and the better
/// response (bidirectional, with a request: eight traces); with `interaural` 16 renders.  With a field: its photons, kMostPhotonsOfErrors
/// at most, once more in the same cells and once in finer ones; of a field with more, twice in the same cells.  The finer field has eight
/// times the cells, each with 2 bytes per merged bin that holds energy (field_bins), coefficient and padded band: up to eight times the
/// memory of the field, for as long as it is measured.
MetricErrors standard_errors(const AcousticScene& acoustics, const EarlyCandidates& candidates, const SourceField* field,
                             glm::vec3 listener, const EnergyResponse& response, const ParameterRequest& request = {},
                             const RenderEars& render_ears = {});

}  // namespace earshot
