// SPDX-License-Identifier: Apache-2.0
#include "sim/sofa/sofa_directivity.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>

#include "sim/audio/measured/listener_frame.h"
#include "sim/sofa/sofa_pose.h"
#include "sim/sofa/sofa_variables.h"

namespace earshot {
namespace {

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
  const SofaReceivers receivers(file, measurements);
  const SofaPose listener(file, "ListenerPosition", {0, 0, 0}, measurements), listener_view(file, "ListenerView", {1, 0, 0}, measurements);
  const SofaPose listener_up(file, "ListenerUp", {0, 0, 1}, measurements, listener_view.type());
  const SofaPose origin(file, "SourcePosition", {0, 0, 0}, measurements), view(file, "SourceView", {1, 0, 0}, measurements);
  const SofaPose up(file, "SourceUp", {0, 0, 1}, measurements, view.type());
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
      if (!(distance.back() > kSofaNoLength) || !std::isfinite(distance.back()))
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
  const SofaFile file(path, "use a FreeFieldDirectivityTF SOFA file", MeasuredSource::kMaxValues);
  require_convention(file, {"FreeFieldDirectivityTF"}, "a source's directivity", "TF");
  require_emitter_at_source(file);
  const SofaVariable frequency = file.get("N");
  if (!frequency.units.empty() && frequency.units != "hertz" && frequency.units != "hz")
    throw file.refuse(fmt::format("has frequencies (N) in '{}' instead of hertz", frequency.units));
  MeasuredSource source{.frequency_hz = frequency.values, .direction = {}, .pressure = {}};
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
