#include "sim/acoustics/rir.h"

namespace earshot {

void compute_energy_response(const AcousticScene& scene, const EarlyCandidates& candidates, glm::vec3 listener,
                             EnergyResponse& response) {
  response.speed_of_sound_m_per_s = scene.speed_of_sound_m_per_s();
  response.arrivals.clear();
  candidates.find_arrivals(scene, listener, response.arrivals);
  if (!has_shape_of(scene, response.late)) response.late = make_histogram(scene);
  response.stats = trace_late(scene, candidates, listener, response.late);
}

}  // namespace earshot
