#pragma once

#include <filesystem>
#include <glm/vec3.hpp>
#include <vector>

namespace earshot {

/// Measured head-related impulse responses as a SOFA file holds them.
struct SofaResponses {
  float sample_rate_hz = 0;
  int num_taps = 0;
  std::vector<glm::vec3> direction;  ///< unit, head axes: x right, y up, -z front
  std::vector<float> taps;           ///< [direction][ear][num_taps], ears left, right
  std::vector<float> delay_samples;  ///< [direction][ear], to be added in front of the taps
};

/// Reads a SOFA file of the convention SimpleFreeFieldHRIR or one like it (libmysofa).  Throws InputError naming the file and the field.
SofaResponses read_sofa(const std::filesystem::path& path);

}  // namespace earshot
