// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/measured_directivity.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>

#include "sim/audio/head/gridded_directivity.h"
#include "sim/audio/measured/clf_text.h"
#include "sim/audio/measured/direction_weights.h"
#include "sim/audio/measured/measured_spheres.h"
#include "sim/audio/measured/source_bands.h"
#include "sim/base/errors.h"
#include "sim/base/process/companion_program.h"
#include "sim/base/process/isolated_call.h"
#include "sim/base/regular_file.h"
#include "sim/base/text/log.h"

namespace earshot {
namespace {

constexpr std::size_t kMaxClfBytes = std::size_t{64} << 20;
constexpr double kLargestGapDeg = 60.0, kSilentAsymmetry = 0.01;

/// The same with each direction once: the mean of its copies.
MeasuredSource without_copies(const MeasuredSource& source) {
  const std::vector<float> unknown(source.direction.size(), 0.f);
  const std::size_t lines = source.frequency_hz.size();
  MeasuredSource single{.frequency_hz = source.frequency_hz, .direction = {}, .pressure = {}};
  for (const MeasuredSphere& sphere : sort_into_spheres(source.direction, unknown))
    for (const MeasuredDirection& measured : sphere.directions) {
      single.direction.push_back(measured.direction);
      for (std::size_t line = 0; line < lines; ++line) {
        std::complex<double> sum = 0;
        for (const std::size_t copy : measured.copies) sum += std::complex<double>(source.pressure[copy * lines + line]);
        single.pressure.emplace_back(sum / static_cast<double>(measured.copies.size()));
      }
    }
  return single;
}

/// Throws if the directions leave a hole of more than kLargestGapDeg around `towards`.
void require_covered(const MeasuredSource& source, glm::vec3 towards, const std::string& where) {
  float nearest = -1;
  for (const glm::vec3 direction : source.direction) nearest = std::max(nearest, glm::dot(direction, towards));
  const double gap_deg = std::acos(std::clamp(static_cast<double>(nearest), -1.0, 1.0)) * 180.0 / std::numbers::pi;
  if (gap_deg > kLargestGapDeg)
    throw InputError(where,
                     fmt::format("has {} directions that leave a hole of {:.0f} degrees around ({:.2f}, {:.2f}, {:.2f}) (right, up, back)",
                                 source.direction.size(), gap_deg, towards.x, towards.y, towards.z),
                     "use a measurement all around the source, in degrees");
}

}  // namespace

std::shared_ptr<const Directivity> measured_directivity(const MeasuredSource& source, const std::string& where) {
  validate(source, where);
  const MeasuredSource single = without_copies(source);
  for (const glm::vec3 axis :
       {glm::vec3(0, 0, -1), glm::vec3(0, 0, 1), glm::vec3(1, 0, 0), glm::vec3(-1, 0, 0), glm::vec3(0, 1, 0), glm::vec3(0, -1, 0)})
    require_covered(single, axis, where);
  const DirectionWeights weights(single.direction);
  const std::size_t lines = single.frequency_hz.size(), directions = single.direction.size();
  std::vector<std::complex<double>> front(lines);
  for (const DirectionWeights::Weight& entry : weights.at({0, 0, -1}))
    for (std::size_t line = 0; line < lines; ++line)
      front[line] += entry.weight * std::complex<double>(single.pressure[entry.direction * lines + line]);
  const SourceBands bands = bands_of(single, front);
  return directivity_on_grid(
      bands.centre_hz,
      [&](glm::vec3 towards, std::span<double> pressure) {
        require_covered(single, towards, where);
        std::ranges::fill(pressure, 0.0);
        for (const DirectionWeights::Weight& entry : weights.at(towards))
          for (std::size_t b = 0; b < pressure.size(); ++b) pressure[b] += entry.weight * bands.pressure[b * directions + entry.direction];
        for (std::size_t b = 0; b < pressure.size(); ++b)
          if (!bands.has_polarity[b]) pressure[b] = std::max(pressure[b], 0.0);
      },
      where);
}

std::shared_ptr<const Directivity> sofa_directivity(const std::filesystem::path& path) {
  const std::string where = path.string();
  IsolationLimits limits = limits_for_file(path);
  limits.worker = "HDF5";
  std::filesystem::path program;
  try {
    program = companion_program("earshot_hdf5_reader", "EARSHOT_HDF5_READER");
  } catch (const RunError&) {
    throw InputError(where, "cannot be read: this installation has no earshot_hdf5_reader, which a build with HDF5 has",
                     "set EARSHOT_HDF5_READER to that program, or use a balloon file or CLF text");
  }
  return measured_directivity(decode_source(call_isolated(program, {"directivity", where}, where, limits), where), where);
}

std::shared_ptr<const Directivity> clf_directivity(const std::filesystem::path& path) {
  return clf_directivity_from_text(read_regular_file(path, kMaxClfBytes), path.string());
}

std::shared_ptr<const Directivity> clf_directivity_from_text(std::string_view text, const std::string& where) {
  const ClfBalloon balloon = parse_clf(text, where);
  if (balloon.asymmetry > kSilentAsymmetry)
    log_warning(
        fmt::format("{}: left and right differ by {:.0f} % of the pressure; their mean power counts, as no public description says "
                    "which is which",
                    where, 100 * balloon.asymmetry));
  const std::size_t angles = balloon.num_angles();
  const double step_rad = static_cast<double>(balloon.step_deg) * std::numbers::pi / 180.0;
  std::vector<double> linear(balloon.level_db.size());
  for (std::size_t i = 0; i < linear.size(); ++i) {
    const double front_db = balloon.level_db[i / (angles * angles) * angles * angles];
    linear[i] = std::pow(10.0, (balloon.level_db[i] - front_db) / 20.0);
  }
  return directivity_on_grid(
      balloon.frequency_hz,
      [&](glm::vec3 towards, std::span<double> pressure) {
        const glm::dvec3 d(towards);
        const auto place = [&](double angle) {
          const double steps = std::clamp(angle / step_rad, 0.0, static_cast<double>(angles - 1));
          const std::size_t low = std::min(static_cast<std::size_t>(steps), angles - 2);
          return std::pair(low, steps - static_cast<double>(low));
        };
        const auto [angle, along] = place(std::atan2(std::hypot(d.x, d.y), -d.z));
        const auto [arc, across] = place(std::atan2(std::abs(d.x), d.y));
        for (std::size_t f = 0; f < pressure.size(); ++f) {
          const double* first = &linear[(f * angles + arc) * angles + angle];
          const double* second = first + angles;
          pressure[f] = (1 - across) * ((1 - along) * first[0] + along * first[1]) + across * ((1 - along) * second[0] + along * second[1]);
        }
      },
      where);
}

}  // namespace earshot
