// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "sim/acoustics/accuracy/accuracy_plan.h"
#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/metrics/standard_errors.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"

namespace earshot {

using OrderedJson = nlohmann::ordered_json;

/// null for a value that does not exist or is not finite.
OrderedJson number_or_null(const std::optional<double>& value);
/// Arrays per band under the names of docs/reference/json_output.md, section 1 (edt_s, t20_s, ...), and drr_db; the parameters of
/// `request`, and under `missing` the reasons of those that do not exist.
OrderedJson metrics_json(const RoomMetrics& metrics, const ParameterRequest& request = {});
/// Adds what is measured on rendered samples: "rir" of an omnidirectional microphone (ISO 3382-1), with the correlation between two ears
/// where `heard` has them.  Beside it, by name, those of each channel of `heard`: "ears" (left, right) or "microphones"; of harmonics and
/// of a microphone alike on all sides nothing.  names: of the channels of `heard`.  how: of both;
/// its lateral parameters are those of the energy response alone.
void add_sample_metrics(const Rir& omni, const Rir& heard, const ListenerLayout& layout, const std::vector<std::string>& names,
                        RirMeasurement how, OrderedJson& json);
/// Arrays per band of what `errors` has (standard_errors.h), with a field without those of `request`.
OrderedJson standard_errors_json(const MetricErrors& errors, bool has_field, const ParameterRequest& request);
/// The request, the predicted error and cost of the choice, and all candidates tried (docs/reference/json_output.md, section 1).
OrderedJson accuracy_json(const AccuracyTarget& target, const AccuracyPlan& plan);

}  // namespace earshot
