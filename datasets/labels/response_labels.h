// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <nlohmann/json_fwd.hpp>

#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/response/energy_response.h"

namespace earshot {

class SourceField;

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

}  // namespace earshot
