#include "sim/acoustics/source_field/field_for_poses.h"

#include "sim/acoustics/model/source_poses.h"

namespace earshot {

bool wants_source_field(const AcousticScene& scene, std::size_t num_poses) {
  const bool is_asked_for = scene.config().field == Switch::on || static_cast<double>(num_poses) >= kPosesPerSource;
  return is_asked_for && uses_source_field(scene);
}

}  // namespace earshot
