// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <nlohmann/json_fwd.hpp>
#include <optional>

#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/response/energy_response.h"

namespace earshot {

class EarlyCandidates;
class SourceField;
struct RoomMetrics;

/// Labels of a response that all manifests have in common.

/// [x, y, z].
nlohmann::ordered_json place_label(glm::dvec3 position);
/// Whether the straight line from the source is free.
bool is_in_sight(const EnergyResponse& response);
/// Time along the straight line: behind a wall, too, the direct sound counts from then.
double direct_delay_s(glm::vec3 source, glm::vec3 listener, const EnergyResponse& response);
/// Of such a time, to a hundredth of a sample at the highest rates, however far the source.
nlohmann::ordered_json rounded_delay(double seconds);
/// drr_db, t20_mid_s, t20_s, rt60_s, c50_db and field_t20_error, from the energy response.  field: null without one.
void add_metrics(const AcousticScene& acoustics, const EnergyResponse& response, const SourceField* field, nlohmann::ordered_json& line);

/// t20_error_s: standard errors of t20_s per band, null where they are not known; an empty list without any (standard_errors.h).
void add_errors(const AcousticScene& acoustics, const EarlyCandidates& candidates, const SourceField* field, glm::vec3 listener,
                const EnergyResponse& response, nlohmann::ordered_json& line);
/// Mean over the octaves at 500 Hz and 1 kHz, as ISO 3382-1 states single numbers; none if one of them has no value.
std::optional<double> mid_t20_s(const RoomMetrics& metrics);

}  // namespace earshot
