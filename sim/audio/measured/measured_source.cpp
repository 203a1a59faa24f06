// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/measured/measured_source.h"

#include <fmt/format.h>

#include <cmath>
#include <glm/geometric.hpp>

#include "sim/base/byte_stream.h"
#include "sim/base/errors.h"

namespace earshot {

void validate(const MeasuredSource& source, const std::string& where) {
  const auto refuse = [&](const std::string& problem) {
    return InputError(where, problem, "use a FreeFieldDirectivityTF SOFA file with valid numbers");
  };
  const std::size_t directions = source.direction.size(), frequencies = source.frequency_hz.size();
  if (directions == 0 || directions > MeasuredSource::kMaxDirections) throw refuse(fmt::format("has {} directions", directions));
  if (frequencies == 0 || frequencies > MeasuredSource::kMaxFrequencies) throw refuse(fmt::format("has {} frequencies (N)", frequencies));
  if (directions * frequencies > MeasuredSource::kMaxValues || source.pressure.size() != directions * frequencies)
    throw refuse(fmt::format("has {} values for {} directions and {} frequencies", source.pressure.size(), directions, frequencies));
  for (std::size_t f = 0; f < frequencies; ++f) {
    const double frequency = source.frequency_hz[f];
    if (!(frequency > 0 && frequency <= 1e6)) throw refuse(fmt::format("has the frequency {} Hz, outside (0, 1e6]", frequency));
    if (f > 0 && !(frequency > source.frequency_hz[f - 1]))
      throw refuse(fmt::format("has frequencies that do not rise at {} Hz", frequency));
  }
  for (std::size_t d = 0; d < directions; ++d)
    if (!(std::abs(glm::length(source.direction[d]) - 1.f) < 1e-3f)) throw refuse(fmt::format("has no direction at position {}", d));
  for (std::size_t i = 0; i < source.pressure.size(); ++i) {
    const std::complex<float> value = source.pressure[i];
    if (!(std::abs(value.real()) <= 1e12f && std::abs(value.imag()) <= 1e12f))
      throw refuse(
          fmt::format("has a value out of range for direction {} at {} Hz", i / frequencies, source.frequency_hz[i % frequencies]));
  }
}

std::string encode_source(const MeasuredSource& source) {
  ByteWriter writer;
  writer.put_list(source.frequency_hz);
  writer.put_list(source.direction);
  writer.put_list(source.pressure);
  return writer.take();
}

MeasuredSource decode_source(std::string_view bytes, const std::string& where) {
  ByteReader reader(bytes, where);
  MeasuredSource source;
  source.frequency_hz = reader.take_list<double>();
  source.direction = reader.take_list<glm::vec3>();
  source.pressure = reader.take_list<std::complex<float>>();
  reader.finish();
  validate(source, where);
  return source;
}

}  // namespace earshot
