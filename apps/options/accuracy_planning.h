// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <vector>

#include "sim/acoustics/accuracy/accuracy_plan.h"

namespace earshot {

/// The cheapest settings that meet --accuracy, for `poses` responses of the source at such places; shows progress and prints the choice.
AccuracyPlan plan_and_print(const AcousticScene& acoustics, const AccuracyTarget& target, const SoundSource& source,
                            const std::vector<glm::vec3>& places, double poses);

}  // namespace earshot
