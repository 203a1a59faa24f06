// SPDX-License-Identifier: Apache-2.0
#include "apps/options/source_options.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "sim/base/errors.h"

namespace earshot {
namespace {

float radians(double degrees) { return static_cast<float>(degrees * std::numbers::pi / 180.0); }

template <class T>
const T& pick(const std::vector<T>& values, std::size_t index, std::size_t count, const char* option) {
  if (values.size() != 1 && values.size() != count)
    throw InputError(option, fmt::format("is given {} times for {} sources", values.size(), count),
                     "give it once for all or once per source");
  return values.size() == 1 ? values.front() : values[index];
}

double finite(double value, const char* option) {
  if (!std::isfinite(value)) throw InputError(option, "is not a finite number", "write an angle in degrees");
  return value;
}

}  // namespace

glm::quat orientation_of(double heading_deg, double pitch_deg, double roll_deg) {
  return glm::angleAxis(radians(heading_deg), glm::vec3(0, 1, 0)) * glm::angleAxis(radians(pitch_deg), glm::vec3(1, 0, 0)) *
         glm::angleAxis(-radians(roll_deg), glm::vec3(0, 0, 1));
}

void SourceOptions::add_to(CLI::App& command) {
  command
      .add_option("--source-pattern", patterns,
                  "Directivity of sources: omni, subcardioid, cardioid, supercardioid, hypercardioid, dipole, voice, or a file: "
                  "a balloon (JSON or YAML), SOFA (FreeFieldDirectivityTF) or CLF text")
      ->capture_default_str()
      ->delimiter(',');
  command.add_option("--source-heading", heading_deg, "Heading of sources in degrees, counter-clockwise from -z seen from above")
      ->capture_default_str()
      ->delimiter(',');
  command.add_option("--source-pitch", pitch_deg, "Pitch of sources in degrees, positive is up")->capture_default_str()->delimiter(',');
  command.add_option("--source-radius", radius_m, "Radius of a spherical source in metres, [0, 10]; 0: point source")
      ->capture_default_str()
      ->delimiter(',');
}

SoundSource SourceOptions::source(std::size_t index, std::size_t count, glm::vec3 position) const {
  SoundSource source(position);
  source.directivity = Directivity::named(pick(patterns, index, count, "--source-pattern"));
  source.orientation = orientation_of(finite(pick(heading_deg, index, count, "--source-heading"), "--source-heading"),
                                      finite(pick(pitch_deg, index, count, "--source-pitch"), "--source-pitch"), 0);
  const double radius = pick(radius_m, index, count, "--source-radius");
  require(radius >= 0 && radius <= 10, "--source-radius", radius, "must be in [0, 10] m");
  source.radius_m = static_cast<float>(radius);
  return source;
}

}  // namespace earshot
