// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/source_field/field_for_poses.h"

#include "sim/acoustics/model/source_poses.h"

namespace earshot {
namespace {

bool are_many(std::size_t num_poses) { return static_cast<double>(num_poses) >= kPosesPerSource; }

}  // namespace

bool wants_source_field(const AcousticScene& scene, std::size_t num_poses) {
  return (scene.config().field == Switch::on || are_many(num_poses)) && uses_source_field(scene);
}

std::shared_ptr<const SourceField> field_for_poses(const AcousticScene& scene, const EarlyCandidates& candidates, std::size_t num_poses,
                                                   const std::function<void(double fraction)>& progress) {
  return wants_source_field(scene, num_poses) ? build_source_field(scene, candidates, progress) : nullptr;
}

Switch field_switch_for_poses(Switch user_set, std::size_t num_poses) {
  return user_set == Switch::automatic && !are_many(num_poses) ? Switch::off : user_set;
}

}  // namespace earshot
