// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/metrics/parameter_request.h"

#include <cmath>
#include <glm/geometric.hpp>

#include "sim/base/errors.h"

namespace earshot {

ParameterRequest parameter_request(const std::vector<std::string>& names, const std::vector<double>& snr_db, const std::string& key,
                                   const std::string& snr_key) {
  ParameterRequest request;
  for (const std::string& name : names) {
    if (name == "lateral")
      request.lateral = true;
    else if (name == "stage")
      request.stage = true;
    else if (name == "speech")
      request.speech = true;
    else if (name == "interaural")
      request.interaural = true;
    else
      throw InputError(key, "'" + name + "' is not a group of parameters", "use " + std::string(kParameterGroups));
  }
  for (const double ratio : snr_db) require(std::isfinite(ratio), snr_key, ratio, "must be finite");
  require(snr_db.size() <= 1 || snr_db.size() == 7, snr_key, snr_db.size(), "must be one ratio, or seven from 125 Hz to 8 kHz");
  if (!snr_db.empty() && !request.speech) throw InputError(snr_key, "has no effect without 'speech'", "add speech to " + key);
  request.snr_db = snr_db;
  return request;
}

std::optional<glm::vec3> lateral_axis(glm::vec3 source, glm::vec3 listener) {
  const glm::vec3 level(source.x - listener.x, 0.f, source.z - listener.z);
  const float length_m = glm::length(level);
  if (!(length_m > 1e-3f)) return std::nullopt;
  return glm::vec3(-level.z, 0.f, level.x) / length_m;
}

}  // namespace earshot
