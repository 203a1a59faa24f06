// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "sim/acoustics/accuracy/accuracy_plan.h"
#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/source_field/source_field.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"

namespace earshot {

using OrderedJson = nlohmann::ordered_json;

/// null for a value that does not exist or is not finite.
OrderedJson number_or_null(const std::optional<double>& value);
/// Arrays per band under the names of docs/reference/json_output.md, section 1 (edt_s, t20_s, ...), and drr_db.
OrderedJson metrics_json(const RoomMetrics& metrics);
/// Adds what is measured on rendered samples: "rir" of an omnidirectional microphone (ISO 3382-1), with the correlation between two ears
/// where `heard` has them.  Beside it, by name, those of each channel of `heard`: "ears" (left, right) or "microphones"; of harmonics and
/// of a microphone alike on all sides nothing.  names: of the channels of `heard`.  delay_s: of the direct sound.
void add_sample_metrics(const Rir& omni, const Rir& heard, const ListenerLayout& layout, const std::vector<std::string>& names,
                        double delay_s, OrderedJson& json);
/// Standard errors per band of rt60_s, edt_s, t20_s, t30_s, c50_db, c80_db, g_db and drr_band_db.  From the batches of a bidirectional
/// response; otherwise by repetition: eight traces with an eighth of the rays and seeds of their own, whose mean spreads as one trace with
/// all rays.  Empty with too few rays. With the late field gathered from `field`: of rt60_s and t20_s only, by its own
/// estimate.
OrderedJson standard_errors_json(const AcousticScene& acoustics, const EarlyCandidates& candidates, const SourceField* field,
                                 glm::vec3 listener, const EnergyResponse& response);
/// The request, the predicted error and cost of the choice, and all candidates tried (docs/reference/json_output.md, section 1).
OrderedJson accuracy_json(const AccuracyTarget& target, const AccuracyPlan& plan);

}  // namespace earshot
