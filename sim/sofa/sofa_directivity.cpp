// SPDX-License-Identifier: Apache-2.0
#include "sim/sofa/sofa_directivity.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>

#include "sim/audio/measured/listener_frame.h"
#include "sim/sofa/sofa_variables.h"

namespace earshot {
namespace {

constexpr double kNoLength = 1e-6, kOffOriginM = 1e-3;

/// Whether these are the units of AES69, with the plural and the spelling of either side of the ocean.
bool are_units(std::string units, bool is_spherical) {
  std::erase(units, ' ');
  std::vector<std::string> parts;
  for (std::size_t at = 0; at <= units.size();) {
    const std::size_t comma = std::min(units.find(',', at), units.size());
    std::string part = units.substr(at, comma - at);
    if (part.ends_with('s')) part.pop_back();
    parts.push_back(part == "meter" || part == "m" ? "metre" : part);
    at = comma + 1;
  }
  if (is_spherical) return parts == std::vector<std::string>{"degree", "degree", "metre"};
  return (parts.size() == 1 || parts.size() == 3) && std::ranges::all_of(parts, [](const std::string& part) { return part == "metre"; });
}

/// Triplets of a pose: one for all measurements, or one for each.
class Pose {
 public:
  Pose(const SofaFile& file, const char* name, glm::dvec3 usual, std::size_t measurements, const std::string& usual_type = "cartesian") {
    std::optional<SofaVariable> variable = file.find(name);
    if (!variable) {
      triplets_.push_back(usual);
      return;
    }
    const std::size_t count = variable->values.size() / 3;
    if (variable->values.size() % 3 != 0 || variable->size.back() != 3 || (count != 1 && count != measurements))
      throw file.refuse(fmt::format("has {} of {} instead of 1 or M = {} triplets", name, variable->shape(), measurements));
    type_ = variable->type.empty() ? usual_type : variable->type;
    if (type_ != "cartesian" && type_ != "spherical")
      throw file.refuse(fmt::format("has {} of Type '{}', which is neither cartesian nor spherical", name, type_));
    if (!variable->units.empty() && !are_units(variable->units, type_ == "spherical"))
      throw file.refuse(
          fmt::format("has {} in '{}' instead of {}", name, variable->units, type_ == "spherical" ? "'degree, degree, metre'" : "'metre'"));
    for (std::size_t i = 0; i < count; ++i) {
      const double* v = &variable->values[3 * i];
      triplets_.push_back(sofa_position({v[0], v[1], v[2]}, type_ == "spherical"));
    }
  }
  [[nodiscard]] glm::dvec3 operator[](std::size_t measurement) const {
    return triplets_.size() == 1 ? triplets_[0] : triplets_[measurement];
  }
  [[nodiscard]] bool changes() const {
    return std::ranges::any_of(triplets_, [&](glm::dvec3 t) { return glm::length(t - triplets_[0]) > kNoLength; });
  }
  [[nodiscard]] const std::string& type() const { return type_; }

 private:
  std::vector<glm::dvec3> triplets_;
  std::string type_ = "cartesian";
};

/// Receivers [R][3] for all measurements, or [R][3][M], in axes of the listener.
class Receivers {
 public:
  Receivers(const SofaFile& file, std::size_t measurements) : variable_(file.get("ReceiverPosition")) {
    const std::vector<std::size_t>& size = variable_.size;
    const bool has_depth = size.size() == 3;
    if ((size.size() != 2 && !has_depth) || size[1] != 3 || (has_depth && size[2] != 1 && size[2] != measurements))
      throw file.refuse(fmt::format("has ReceiverPosition of {} instead of R x 3 x 1 or R x 3 x M", variable_.shape()));
    depth_ = has_depth ? size[2] : 1;
    if (variable_.type != "cartesian" && variable_.type != "spherical")
      throw file.refuse(fmt::format("has ReceiverPosition of Type '{}', which is neither cartesian nor spherical", variable_.type));
    is_spherical_ = variable_.type == "spherical";
    if (!variable_.units.empty() && !are_units(variable_.units, is_spherical_))
      throw file.refuse(fmt::format("has ReceiverPosition in '{}' instead of {}", variable_.units,
                                    is_spherical_ ? "'degree, degree, metre'" : "'metre'"));
  }
  [[nodiscard]] std::size_t count() const { return variable_.size[0]; }
  [[nodiscard]] bool changes() const { return depth_ > 1; }
  [[nodiscard]] glm::dvec3 at(std::size_t receiver, std::size_t measurement) const {
    const std::size_t m = depth_ == 1 ? 0 : measurement;
    const auto value = [&](std::size_t axis) { return variable_.values[(3 * receiver + axis) * depth_ + m]; };
    return sofa_position({value(0), value(1), value(2)}, is_spherical_);
  }

 private:
  SofaVariable variable_;
  std::size_t depth_ = 1;
  bool is_spherical_ = false;
};

void require_view(const SofaFile& file, const Pose& pose, std::size_t measurements, const char* name) {
  for (std::size_t m = 0; m < measurements; ++m)
    if (!(glm::length(pose[m]) > kNoLength)) throw file.refuse(fmt::format("has no direction in {} {}", name, m));
}

void require_convention(const SofaFile& file) {
  if (file.attribute("Conventions") != "SOFA") throw file.refuse("is HDF5, but no SOFA file: the attribute Conventions is not SOFA");
  if (const std::string convention = file.attribute("SOFAConventions"); convention != "FreeFieldDirectivityTF")
    throw file.refuse(fmt::format("follows the SOFA convention '{}', which is not that of a source's directivity", convention));
  if (const std::string type = file.attribute("DataType"); type != "TF")
    throw file.refuse(fmt::format("has DataType '{}' instead of TF", type));
}

SofaVariable read_data(const SofaFile& file, const char* name, std::size_t receivers, std::size_t frequencies) {
  SofaVariable data = file.get(name);
  if (data.size.size() != 3 || data.size[1] != receivers || data.size[2] != frequencies)
    throw file.refuse(fmt::format("has {} of {} instead of M x R x N = M x {} x {}", name, data.shape(), receivers, frequencies));
  for (std::size_t i = 0; i < 3; ++i)
    if (data.dimensions[i] != '?' && data.dimensions[i] != "MRN"[i] && data.size[i] != 1)
      throw file.refuse(fmt::format("has {} with dimensions {} instead of MRN", name, data.dimensions));
  return data;
}

/// Writes directions and pressures of all receivers in all measurements.
void place_receivers(const SofaFile& file, const SofaVariable& real, const SofaVariable& imaginary, MeasuredSource& source) {
  const std::size_t measurements = real.size[0], lines = real.size[2];
  const Receivers receivers(file, measurements);
  const Pose listener(file, "ListenerPosition", {0, 0, 0}, measurements), listener_view(file, "ListenerView", {1, 0, 0}, measurements);
  const Pose listener_up(file, "ListenerUp", {0, 0, 1}, measurements, listener_view.type());
  const Pose origin(file, "SourcePosition", {0, 0, 0}, measurements), view(file, "SourceView", {1, 0, 0}, measurements);
  const Pose up(file, "SourceUp", {0, 0, 1}, measurements, view.type());
  require_view(file, listener_view, measurements, "ListenerView");
  require_view(file, view, measurements, "SourceView");
  const bool is_turned = receivers.changes() || listener.changes() || listener_view.changes() || listener_up.changes() ||
                         origin.changes() || view.changes() || up.changes();
  if (measurements > 1 && !is_turned)
    throw file.refuse(
        fmt::format("has {} measurements (M) of the same directions, as of several notes: write one into a file of its own", measurements));
  std::vector<double> distance;
  double sum = 0;
  for (std::size_t m = 0; m < measurements; ++m) {
    const ListenerFrame of_listener(glm::dvec3(0), listener_view[m], listener_up[m]), of_source(origin[m], view[m], up[m]);
    // Rows: right, up and back of the listener in the room.
    const glm::dmat3 to_listener(of_listener.to_head({1, 0, 0}), of_listener.to_head({0, 1, 0}), of_listener.to_head({0, 0, 1}));
    for (std::size_t r = 0; r < receivers.count(); ++r) {
      const glm::dvec3 local = receivers.at(r, m);
      const glm::dvec3 in_room = listener[m] + glm::transpose(to_listener) * glm::dvec3(-local.y, local.z, -local.x);
      const glm::dvec3 towards = of_source.to_head(in_room);
      distance.push_back(glm::length(towards));
      if (!(distance.back() > kNoLength) || !std::isfinite(distance.back()))
        throw file.refuse(fmt::format("has no direction from the source to receiver {} of measurement {}", r, m));
      source.direction.emplace_back(towards / distance.back());
      sum += distance.back();
    }
  }
  const double mean = sum / static_cast<double>(distance.size());
  for (std::size_t i = 0; i < distance.size() * lines; ++i) {
    const double scale = distance[i / lines] / mean;
    source.pressure.emplace_back(static_cast<float>(scale * real.values[i]), static_cast<float>(scale * imaginary.values[i]));
  }
}

/// Leaves out a first line of 0 Hz, with which a Fourier transform begins: no band reaches down to it.
void leave_out_zero_hertz(MeasuredSource& source) {
  const std::size_t lines = source.frequency_hz.size();
  if (lines < 2 || source.frequency_hz.front() != 0.0) return;
  source.frequency_hz.erase(source.frequency_hz.begin());
  std::size_t kept = 0;
  for (std::size_t i = 0; i < source.pressure.size(); ++i)
    if (i % lines != 0) source.pressure[kept++] = source.pressure[i];
  source.pressure.resize(kept);
}

}  // namespace

MeasuredSource read_sofa_directivity(const std::filesystem::path& path) {
  const SofaFile file(path);
  require_convention(file);
  const SofaVariable frequency = file.get("N");
  if (!frequency.units.empty() && frequency.units != "hertz" && frequency.units != "hz")
    throw file.refuse(fmt::format("has frequencies (N) in '{}' instead of hertz", frequency.units));
  MeasuredSource source{.frequency_hz = frequency.values, .direction = {}, .pressure = {}};
  if (const auto emitter = file.find("EmitterPosition"))
    for (const double value : emitter->values)
      if (std::abs(value) > kOffOriginM) throw file.refuse("has an EmitterPosition off the origin of the source");
  const SofaVariable receivers = file.get("ReceiverPosition");
  if (receivers.size.empty()) throw file.refuse("has one number in ReceiverPosition");
  const SofaVariable real = read_data(file, "Data.Real", receivers.size[0], frequency.values.size());
  const SofaVariable imaginary = read_data(file, "Data.Imag", receivers.size[0], frequency.values.size());
  if (real.size != imaginary.size)
    throw file.refuse(fmt::format("has Data.Real of {} and Data.Imag of {}", real.shape(), imaginary.shape()));
  if (real.size[0] * real.size[1] > MeasuredSource::kMaxDirections)
    throw file.refuse(fmt::format("has {} directions, more than {}", real.size[0] * real.size[1], MeasuredSource::kMaxDirections));
  place_receivers(file, real, imaginary, source);
  leave_out_zero_hertz(source);
  validate(source, path.string());
  return source;
}

}  // namespace earshot
