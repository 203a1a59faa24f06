// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/metrics/late_errors.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "sim/acoustics/core/jackknife.h"
#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/response/scattered_energy.h"

namespace earshot {
namespace {

/// The response with the late energy of all batches but one; energy scattered by panels belongs to no batch and stays whole.  Harmonics
/// above order 0
/// are left as they are: no decay time depends on them.
void leave_out(const EnergyResponse& whole, const EnergyHistogram& scattered, int batch, EnergyResponse& rest) {
  const LateBatches& batches = whole.batches;
  const double n = batches.count;
  const auto stride = static_cast<std::size_t>(whole.late.num_coefficients());
  for (int bin = 0; bin < batches.num_bins; ++bin) {
    for (int band = 0; band < batches.num_bands; ++band) {
      double sum = 0;
      for (int i = 0; i < batches.count; ++i) {
        if (i != batch) sum += batches.at(i, bin, band);
      }
      rest.late.values()[(static_cast<std::size_t>(bin) * batches.num_bands + band) * stride] =
          static_cast<float>(sum / (n - 1)) + scattered.energy(bin, band);
    }
  }
}

/// Adds unseen chains within bins [first, last) to the late field `late_field` of a response; false if there are none.
bool add_unseen(const LateBatches& batches, int first, int last, EnergyHistogram& late_field) {
  const auto stride = static_cast<std::size_t>(late_field.num_coefficients());
  bool is_audible = false;
  for (int band = 0; band < batches.num_bands; ++band) {
    const auto at = [&](int bin) { return static_cast<std::size_t>(bin) * batches.num_bands + band; };
    int end = last;
    while (end > first && !(batches.unseen[at(end - 1)] > 0.f)) --end;
    float latest = 0;  // bins between two rays hold what the earlier one may
    for (int bin = first; bin < end; ++bin) {
      if (batches.unseen[at(bin)] > 0.f) latest = batches.unseen[at(bin)];
      late_field.values()[at(bin) * stride] += latest;
    }
    is_audible = is_audible || latest > 0.f;
  }
  return is_audible;
}

/// Per band and statistic.
using Differences = std::vector<std::array<double, kErrorEntries.size()>>;
void add_squares(const RoomMetrics& a, const RoomMetrics& b, Differences& squares) {
  for (std::size_t band = 0; band < squares.size(); ++band) {
    for (std::size_t e = 0; e < kErrorEntries.size(); ++e) {
      const auto &from = a.bands[band].*kErrorEntries[e].value, &to = b.bands[band].*kErrorEntries[e].value;
      if (from && to) squares[band][e] += (*to - *from) * (*to - *from);
    }
  }
}

/// Late energy of each band with its error: the spread of the batches.
std::vector<BandErrors> late_energy_errors(const LateBatches& batches, const EnergyHistogram& scattered) {
  std::vector<BandErrors> errors(static_cast<std::size_t>(batches.num_bands));
  for (int band = 0; band < batches.num_bands; ++band) {
    double mean = 0, squares = 0;
    std::vector<double> total(static_cast<std::size_t>(batches.count), 0.0);
    for (int i = 0; i < batches.count; ++i) {
      for (int bin = 0; bin < batches.num_bins; ++bin) total[i] += batches.at(i, bin, band);
      mean += total[i] / batches.count;
    }
    for (const double energy : total) squares += (energy - mean) * (energy - mean);
    errors[band].late_energy = mean;
    for (int bin = 0; bin < batches.num_bins; ++bin) errors[band].late_energy += static_cast<double>(scattered.energy(bin, band));
    errors[band].late_energy_error = std::sqrt(squares / (double{1} * batches.count * (batches.count - 1)));
  }
  return errors;
}

/// Sets the errors of all statistics from what each is without one batch.  rest: as `response`; its late field is overwritten.
void set_batch_errors(const AcousticScene& scene, const EnergyResponse& response, const EnergyHistogram& scattered, EnergyResponse& rest,
                      std::vector<BandErrors>& errors) {
  const int num_batches = response.batches.count;
  std::array<std::vector<std::vector<std::optional<double>>>, kErrorEntries.size()> values;
  values.fill(std::vector<std::vector<std::optional<double>>>(errors.size()));
  for (int i = 0; i < num_batches; ++i) {
    leave_out(response, scattered, i, rest);
    const RoomMetrics metrics = measure(scene, rest);
    for (std::size_t band = 0; band < errors.size(); ++band)
      for (std::size_t e = 0; e < kErrorEntries.size(); ++e) values[e][band].push_back(metrics.bands[band].*kErrorEntries[e].value);
  }
  const double factor = student_factor(num_batches - 1);
  for (std::size_t band = 0; band < errors.size(); ++band) {
    for (std::size_t e = 0; e < kErrorEntries.size(); ++e) {
      std::optional<double>& error = errors[band].*kErrorEntries[e].error;
      error = jackknife_error(values[e][band]);
      if (error) *error *= factor;
    }
  }
}

/// Adds to the errors what chains that no ray followed may bring.  Per octave of time, as the rays that follow a chain thin out with
/// 1 / t^2: each octave by itself, in quadrature, or all at once if that weighs more (a chain is missed as a whole).  rest: as in
/// set_batch_errors.
void add_unseen_errors(const AcousticScene& scene, const EnergyResponse& response, EnergyResponse& rest, std::vector<BandErrors>& errors) {
  const LateBatches& batches = response.batches;
  const RoomMetrics as_is = measure(scene, response);
  Differences apart(errors.size()), together(errors.size());
  EnergyHistogram all = response.late;
  for (int last = batches.num_bins; last > 1; last = (last + 1) / 2) {
    std::copy(response.late.values().begin(), response.late.values().end(), rest.late.values().begin());
    if (!add_unseen(batches, (last + 1) / 2, last, rest.late)) continue;
    add_unseen(batches, (last + 1) / 2, last, all);
    add_squares(as_is, measure(scene, rest), apart);
  }
  std::copy(all.values().begin(), all.values().end(), rest.late.values().begin());
  add_squares(as_is, measure(scene, rest), together);
  for (std::size_t band = 0; band < errors.size(); ++band) {
    for (std::size_t e = 0; e < kErrorEntries.size(); ++e) {
      std::optional<double>& error = errors[band].*kErrorEntries[e].error;
      if (error) error = std::sqrt(*error * *error + std::max(apart[band][e], together[band][e]));
    }
  }
}

}  // namespace

std::vector<BandErrors> late_errors(const AcousticScene& scene, const EnergyResponse& response) {
  const LateBatches& batches = response.batches;
  if (batches.count < 2) return {};
  EnergyHistogram scattered(response.late.num_bins(), response.late.num_bands(), 0, response.late.bin_s());
  add_scattered_energy(response.scattered, response.speed_of_sound_m_per_s, scattered);
  std::vector<BandErrors> errors = late_energy_errors(batches, scattered);

  EnergyResponse rest;
  rest.arrivals = response.arrivals;
  rest.late = response.late;
  rest.speed_of_sound_m_per_s = response.speed_of_sound_m_per_s;
  rest.air = response.air;
  set_batch_errors(scene, response, scattered, rest, errors);
  if (!batches.unseen.empty()) add_unseen_errors(scene, response, rest, errors);
  return errors;
}

}  // namespace earshot
