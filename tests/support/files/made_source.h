// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <hdf5.h>

#include <cmath>
#include <complex>
#include <functional>
#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "sim/sofa/netcdf_file.h"

namespace earshot {

/// Pressure at 1 m from a source in closed form.  direction: unit, axes of SOFA in those of the source: x front, y left, z up.
using SourcePattern = std::function<std::complex<double>(glm::dvec3 direction, double frequency_hz)>;

/// Front, left and up of a source or a listener in the room, and its place.
struct MadePose {
  glm::dvec3 place{0}, front{1, 0, 0}, up{0, 0, 1};
  [[nodiscard]] glm::dmat3 axes() const { return {front, glm::cross(up, front), up}; }
};

/// A FreeFieldDirectivityTF file of a pattern in closed form, and all that can be wrong with one.
struct MadeSource {
  SourcePattern pattern;
  std::vector<glm::dvec3> receivers{};  ///< from the source, in its axes, metres
  std::vector<double> frequency_hz{};
  MadePose source{}, listener{};
  bool spherical = true, in_radians = false;
  std::string convention = "FreeFieldDirectivityTF", data_type = "TF", data_order = "MRN";
  std::string frequency_units = "hertz", receiver_units{};  ///< empty: those of AES69
  std::string left_out{};                                   ///< a variable that the file lacks
  std::size_t measurements = 1;
  double emitter_m = 0, replaced_by = 0;  ///< replaced_by: unless 0, the value of one number of Data.Imag

  /// Every `step_deg` in azimuth and elevation, poles once per azimuth, elevations from `lowest_deg` to `highest_deg`.
  void add_grid(double step_deg, double radius_m, double lowest_deg = -90, double highest_deg = 90) {
    for (double elevation = lowest_deg; elevation <= highest_deg + 1e-9; elevation += step_deg)
      for (double azimuth = 0; azimuth < 360 - 1e-9; azimuth += step_deg) {
        const double a = azimuth * std::numbers::pi / 180, e = elevation * std::numbers::pi / 180;
        receivers.push_back(radius_m * glm::dvec3(std::cos(e) * std::cos(a), std::cos(e) * std::sin(a), std::sin(e)));
      }
  }
  /// Points spread evenly over a sphere, in no rows.
  void add_spiral(int count, double radius_m) {
    for (int i = 0; i < count; ++i) {
      const double height = (2.0 * i + 1.0) / count - 1.0, level = std::sqrt(1.0 - height * height);
      const double angle = 2.0 * std::numbers::pi * std::fmod(i * std::numbers::phi, 1.0);
      receivers.push_back(radius_m * glm::dvec3(height, level * std::cos(angle), level * std::sin(angle)));
    }
  }

  [[nodiscard]] std::string bytes() const {
    NetcdfFile file("source.sofa");
    for (const auto& [name, text] : {std::pair<const char*, std::string>{"Conventions", "SOFA"},
                                     {"Version", "2.1"},
                                     {"SOFAConventions", convention},
                                     {"SOFAConventionsVersion", "1.1"},
                                     {"DataType", data_type},
                                     {"RoomType", "free field"},
                                     {"Title", "made"}})
      file.add_attribute(name, text);
    for (const auto& [name, size] :
         {std::pair<char, std::size_t>{'I', 1}, {'C', 3}, {'R', receivers.size()}, {'E', 1}, {'M', measurements}})
      file.add_dimension(name, size);
    const auto add = [&](const std::string& name, const std::string& dimensions, const std::vector<double>& values,
                         const NetcdfFile::Attributes& attributes = {}) {
      if (name != left_out) file.add_variable(name, dimensions, values, attributes);
    };
    const NetcdfFile::Attributes cartesian{{"Type", "cartesian"}, {"Units", "metre"}};
    if (left_out == "N")
      file.add_dimension('N', frequency_hz.size());
    else
      file.add_coordinate('N', frequency_hz, {{"LongName", "frequency"}, {"Units", frequency_units}});
    const auto add_pose = [&](const std::string& who, const MadePose& pose) {
      const auto components = [](glm::dvec3 v) { return std::vector<double>{v.x, v.y, v.z}; };
      add(who + "Position", "IC", components(pose.place), cartesian);
      add(who + "View", "IC", components(pose.front), cartesian);
      add(who + "Up", "IC", components(pose.up), cartesian);
    };
    add_pose("Listener", listener);
    add_pose("Source", source);
    add("EmitterPosition", "ECI", {emitter_m, 0, 0}, cartesian);
    add_receivers(add);
    add_data(add);
    return file.finish();
  }

 private:
  template <class Add>
  void add_receivers(const Add& add) const {
    std::vector<double> values;
    const double unit = in_radians ? 1.0 : 180 / std::numbers::pi;
    for (const glm::dvec3 receiver : receivers) {
      const glm::dvec3 in_room = source.place + source.axes() * receiver;
      glm::dvec3 local = glm::transpose(listener.axes()) * (in_room - listener.place);
      const double radius = glm::length(local);
      if (spherical) local = {std::atan2(local.y, local.x) * unit, std::asin(local.z / radius) * unit, radius};
      for (int axis = 0; axis < 3; ++axis) values.push_back(local[axis]);
    }
    const std::string usual = spherical ? "degree, degree, metre" : "metre";
    add("ReceiverPosition", "RCI", values,
        {{"Type", spherical ? "spherical" : "cartesian"}, {"Units", receiver_units.empty() ? usual : receiver_units}});
  }
  template <class Add>
  void add_data(const Add& add) const {
    const std::size_t count = measurements * receivers.size() * frequency_hz.size();
    std::vector<double> real(count), imaginary(count);
    // In the order of the letters, last fastest.
    const auto extent = [&](char letter) { return letter == 'M' ? measurements : letter == 'R' ? receivers.size() : frequency_hz.size(); };
    for (std::size_t i = 0; i < count; ++i) {
      std::size_t rest = i, receiver = 0, line = 0;
      for (std::size_t axis = 3; axis-- > 0;) {
        const std::size_t index = rest % extent(data_order[axis]);
        rest /= extent(data_order[axis]);
        if (data_order[axis] == 'R') receiver = index;
        if (data_order[axis] == 'N') line = index;
      }
      const double radius = glm::length(receivers[receiver]);
      const std::complex<double> pressure = pattern(receivers[receiver] / radius, frequency_hz[line]) / radius;
      real[i] = pressure.real();
      imaginary[i] = pressure.imag();
    }
    if (replaced_by != 0) imaginary[count / 2] = replaced_by;
    add("Data.Real", data_order, real, {});
    add("Data.Imag", data_order, imaginary, {});
  }
};

}  // namespace earshot
