// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <hdf5.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <numbers>
#include <string>
#include <vector>

#include "sim/base/random.h"
#include "sim/sofa/netcdf_file.h"

namespace earshot {

/// What a file of a head holds, in axes of SOFA: x front, y left, z up.
struct HeadFile {
  std::vector<double> sources{};  ///< [measurement][3]
  std::vector<double> taps{};     ///< [measurement][2][num_taps]
  std::size_t num_taps = 0;
  double rate_hz = 48000;
  bool spherical = false;  ///< sources as azimuth, elevation, radius
  bool right_named_first = false;
  glm::dvec3 position{0}, view{1, 0, 0}, up{0, 0, 1};
  std::string convention = "SimpleFreeFieldHRIR", data_type = "FIR";
};

/// The bytes of a SOFA file.
inline std::string head_file(const HeadFile& head) {
  NetcdfFile file("head.sofa");
  for (const auto& [name, text] : {std::pair<const char*, std::string>{"Conventions", "SOFA"},
                                   {"Version", "2.1"},
                                   {"SOFAConventions", head.convention},
                                   {"SOFAConventionsVersion", "1.0"},
                                   {"DataType", head.data_type},
                                   {"RoomType", "free field"},
                                   {"Title", "made"}})
    file.add_attribute(name, text);
  for (const auto& [name, size] :
       {std::pair<char, std::size_t>{'I', 1}, {'C', 3}, {'R', 2}, {'E', 1}, {'N', head.num_taps}, {'M', head.sources.size() / 3}})
    file.add_dimension(name, size);
  const NetcdfFile::Attributes cartesian{{"Type", "cartesian"}, {"Units", "metre"}};
  const NetcdfFile::Attributes spherical{{"Type", "spherical"}, {"Units", "degree, degree, metre"}};
  const auto components = [](glm::dvec3 v) { return std::vector<double>{v.x, v.y, v.z}; };
  file.add_variable("ListenerPosition", "IC", components(head.position), cartesian);
  file.add_variable("ListenerView", "IC", components(head.view), cartesian);
  file.add_variable("ListenerUp", "IC", components(head.up));
  const double side = head.right_named_first ? -0.09 : 0.09;
  file.add_variable("ReceiverPosition", "RCI", std::vector<double>{0, side, 0, 0, -side, 0}, cartesian);
  file.add_variable("SourcePosition", "MC", head.sources, head.spherical ? spherical : cartesian);
  file.add_variable("EmitterPosition", "ECI", std::vector<double>(3, 0.0), cartesian);
  file.add_variable("Data.SamplingRate", "I", std::vector<double>{head.rate_hz}, {{"Units", "hertz"}});
  file.add_variable("Data.Delay", "IR", std::vector<double>(2, 0.0));
  file.add_variable(head.data_type == "FIR" ? "Data.IR" : "Data.Real", "MRN", head.taps);
  return file.finish();
}

/// A head in closed form, written as a SOFA file: an ear hears a source at the angle a from its side with the pressure 1 + level * cos a,
/// early by early_samples * cos a.  All positions in axes of SOFA: x front, y left, z up.
struct MadeHead {
  struct Measurement {
    glm::dvec3 from_head{1, 0, 0};  ///< in the head's axes, metres
    double level = 0.5;
  };
  std::vector<Measurement> measurements{};
  double early_samples = 12, second_gain = 1;  ///< second_gain: of the second receiver
  double rate_hz = 48000;
  bool right_named_first = false, right_stored_first = false;
  glm::dvec3 position{0}, view{1, 0, 0}, up{0, 0, 1};
  bool spherical = false;  ///< sources as azimuth, elevation, radius
  std::string convention = "SimpleFreeFieldHRIR", data_type = "FIR";

  static constexpr std::size_t kTaps = 128;
  static constexpr double kMiddle = 40;

  /// Points spread evenly over a sphere.
  void add_sphere(int count, double distance_m, double level) {
    for (int i = 0; i < count; ++i) {
      const double height = (2.0 * i + 1.0) / count - 1.0, radius = std::sqrt(1.0 - height * height);
      const double angle = 2.0 * std::numbers::pi * std::fmod(i * std::numbers::phi, 1.0);
      measurements.push_back({distance_m * glm::dvec3(radius * std::cos(angle), radius * std::sin(angle), height), level});
    }
  }
  /// Level of the left ear over the right one, and its lead in seconds, for a source in this direction.
  [[nodiscard]] double level_db(double lateral, double level) const {
    return 20.0 * std::log10((1.0 + level * lateral) / (1.0 - level * lateral));
  }
  [[nodiscard]] double lead_s(double lateral) const { return 2.0 * early_samples * lateral / rate_hz; }

  [[nodiscard]] std::string bytes() const {
    const glm::dvec3 front = glm::normalize(view), left = glm::normalize(glm::cross(up, front)), above = glm::cross(front, left);
    std::vector<double> taps, sources;
    for (const Measurement& m : measurements) {
      const glm::dvec3 place = position + m.from_head.x * front + m.from_head.y * left + m.from_head.z * above;
      append_place(place, sources);
      const double lateral = glm::normalize(m.from_head).y;
      for (const int receiver : {0, 1}) {
        const double side = (receiver == 0) != right_stored_first ? lateral : -lateral;
        append_response((receiver == 0 ? 1.0 : second_gain) * (1.0 + m.level * side), kMiddle - early_samples * side, taps);
      }
    }
    return head_file({.sources = sources,
                      .taps = taps,
                      .num_taps = kTaps,
                      .rate_hz = rate_hz,
                      .spherical = spherical,
                      .right_named_first = right_named_first,
                      .position = position,
                      .view = view,
                      .up = up,
                      .convention = convention,
                      .data_type = data_type});
  }

 private:
  void append_place(glm::dvec3 place, std::vector<double>& sources) const {
    const double radius = glm::length(place), degree = std::numbers::pi / 180;
    if (spherical) place = {std::atan2(place.y, place.x) / degree, std::asin(place.z / radius) / degree, radius};
    for (int axis = 0; axis < 3; ++axis) sources.push_back(place[axis]);
  }
  /// An impulse between samples, by a sinc under a window.
  static void append_response(double gain, double at, std::vector<double>& taps) {
    for (std::size_t n = 0; n < kTaps; ++n) {
      const double x = static_cast<double>(n) - at, y = std::numbers::pi * x;
      const double window = std::abs(x) < 24 ? 0.5 + 0.5 * std::cos(y / 24) : 0.0;
      taps.push_back(gain * window * (std::abs(x) < 1e-9 ? 1.0 : std::sin(y) / y));
    }
  }
};

}  // namespace earshot
