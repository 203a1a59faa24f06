// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/metrics/standard_errors.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "sim/acoustics/metrics/band_metric_keys.h"
#include "sim/acoustics/metrics/draw_spread.h"
#include "sim/acoustics/metrics/late_errors.h"
#include "sim/acoustics/response/scattered_energy.h"
#include "sim/acoustics/source_field/source_field.h"

namespace earshot {
namespace {

using BandValue = std::optional<double> BandMetrics::*;
using BandDraws = std::vector<std::vector<BandMetrics>>;  ///< [draw][band]

constexpr int kRepetitions = 8;
/// Least rays of the trace that tells a bias, and what few rays miss.  Without the bias few rays arrive over mirrors: of 64 the late energy
/// may be nil.
constexpr int kBiasRays = 2048;
/// Of the difference to a better response: twice this covers it where that response is itself off by a sixth of it.
constexpr double kOfDifference = 0.6;
/// Walls that scatter less are mirrors.
constexpr double kMostScattering = 0.1;
/// Cells that tell the blur of a field's, and by what fraction of its noise they differ for their own.
constexpr float kFinerCells = 0.5f, kLeastCellM = 0.05f;
constexpr double kNoiseOfCells = 0.5;
constexpr std::array<BandValue, 3> kInteraural{&BandMetrics::iacc, &BandMetrics::iacc_early, &BandMetrics::iacc_late};

/// Of one draw, times `factor`.
std::optional<double> error_of_draws(const BandDraws& draws, std::size_t band, BandValue value, double factor) {
  std::vector<double> values;
  for (const std::vector<BandMetrics>& draw : draws)
    if (draw[band].*value) values.push_back(*(draw[band].*value));
  const std::optional<double> error = spread_of_draws(values);
  return error ? std::optional(*error * factor) : std::nullopt;
}

/// May mirrors bias the trace (AcousticConfig::diffuse_last_segment), and can the estimator without this bias tell?  Behind a wall hardly
/// any of its rays arrives.
bool may_be_biased(const AcousticScene& acoustics, const EnergyResponse& response) {
  const bool in_sight = std::ranges::any_of(response.arrivals, [](const Arrival& arrival) { return arrival.kind == ArrivalKind::direct; });
  return acoustics.config().diffuse_last_segment && (in_sight || !traces_transmission(acoustics));
}

/// The scene with last segments as they are, under the same plan.
AcousticScene without_diffuse_last_segment(const AcousticScene& acoustics) {
  AcousticConfig config = acoustics.config();
  config.diffuse_last_segment = false;
  return {AcousticSurfaces(acoustics.shared_scene(), config, acoustics.surfaces().found()), acoustics.plan()};
}

/// The parameters of a trace with more rays.
std::vector<BandMetrics> trace_with_many_rays(const AcousticScene& acoustics, const EarlyCandidates& candidates, glm::vec3 listener) {
  const AcousticScene scene = acoustics.with_rays(std::max(acoustics.config().rays, kBiasRays), acoustics.config().seed + kCarrierStep);
  EnergyResponse response;
  compute_energy_response(scene, candidates, listener, response);
  return measure(scene, response).bands;
}

/// Do walls reflect as mirrors, in the mean over their area and bands?
bool has_mirrors_alone(const AcousticScene& acoustics) {
  const TriangleMesh& mesh = acoustics.scene().mesh();
  double area_m2 = 0, scattered_m2 = 0;
  for (std::uint32_t triangle = 0; triangle < mesh.triangles.size(); ++triangle) {
    const double of_triangle_m2 = static_cast<double>(acoustics.scene().triangle_area_m2(triangle));
    const std::span<const float> scattering = acoustics.scattering(mesh.triangle_material[triangle]);
    area_m2 += of_triangle_m2;
    for (const float of_band : scattering) scattered_m2 += of_triangle_m2 * double{of_band} / static_cast<double>(scattering.size());
  }
  return scattered_m2 < kMostScattering * area_m2;
}

/// The same without the bias.  Between facing mirrors, and where nearly all walls are mirrors, from photons: rays meet few of the
/// long chains there, and the late decay is theirs.
std::vector<BandMetrics> trace_without_bias(const AcousticScene& acoustics, const EarlyCandidates& candidates, glm::vec3 listener) {
  if (!candidates.long_chains() && !has_mirrors_alone(acoustics))
    return trace_with_many_rays(without_diffuse_last_segment(acoustics), candidates, listener);
  EnergyResponse response;
  compute_energy_response(acoustics, candidates, build_source_field(acoustics, candidates).get(), listener, response);
  return measure(acoustics, response).bands;
}

/// Repeats the trace with `rays` and visits each.
void repeat_trace(const AcousticScene& acoustics, const EarlyCandidates& candidates, glm::vec3 listener, int rays,
                  const std::function<void(const AcousticScene&, const EnergyResponse&)>& visit) {
  for (int i = 1; i <= kRepetitions; ++i) {
    const AcousticScene scene = acoustics.with_rays(rays, acoustics.config().seed + kCarrierStep * static_cast<std::uint64_t>(i));
    EnergyResponse response;
    compute_energy_response(scene, candidates, listener, response);
    visit(scene, response);
  }
}

std::vector<BandMetrics> errors_of_batches(const std::vector<BandErrors>& batches) {
  std::vector<BandMetrics> errors;
  for (const BandErrors& of_band : batches) {
    BandMetrics& error = errors.emplace_back();
    error.rt60_s = of_band.t30_error_s ? of_band.t30_error_s : of_band.t20_error_s;
    for (const ErrorEntry& entry : kErrorEntries) error.*entry.value = of_band.*entry.error;
  }
  return errors;
}

/// Late fields of repeated traces as batches of the trace that they make up together.
struct RepeatedTraces {
  EnergyResponse together;  ///< its late field is empty: late_errors() takes that of the batches

  void add(const EnergyResponse& part) {
    LateBatches& batches = together.batches;
    if (batches.count++ == 0) {
      together.arrivals = part.arrivals;
      together.scattered = part.scattered;
      together.speed_of_sound_m_per_s = part.speed_of_sound_m_per_s;
      together.air = part.air;
      together.late = EnergyHistogram(part.late.num_bins(), part.late.num_bands(), 0, part.late.bin_s());
      batches.num_bins = part.late.num_bins(), batches.num_bands = part.late.num_bands();
    }
    EnergyHistogram scattered(part.late.num_bins(), part.late.num_bands(), 0, part.late.bin_s());
    add_scattered_energy(part.scattered, part.speed_of_sound_m_per_s, scattered);
    for (int bin = 0; bin < batches.num_bins; ++bin)
      for (int band = 0; band < batches.num_bands; ++band)
        batches.energy.push_back(std::max(part.late.energy(bin, band) - scattered.energy(bin, band), 0.f));
  }
};

/// Correlations of the ears of a response, in the octaves of `config`.
std::vector<BandMetrics> correlations(const AcousticConfig& config, const Rir& ears, double delay_s) {
  return measure_interaural(ears, {.direct_delay_s = delay_s, .low_octave = config.low_octave});
}

/// Errors of IACC: of the mean of repeated traces, in quadrature with the spread of one set of carriers.
std::vector<BandMetrics> interaural_errors(const AcousticConfig& config, const EnergyResponse& response, double delay_s,
                                           const RenderEars& render_ears, const BandDraws& traced, double factor) {
  BandDraws carried;
  Rir ears;
  for (std::uint64_t carriers = 1; carriers <= kRepetitions; ++carriers) {
    render_ears(response, carriers, ears);
    carried.push_back(correlations(config, ears, delay_s));
  }
  std::vector<BandMetrics> errors(carried[0].size());
  for (std::size_t band = 0; band < errors.size(); ++band)
    for (const BandValue value : kInteraural) {
      const std::optional<double> of_trace = error_of_draws(traced, band, value, factor),
                                  of_carriers = error_of_draws(carried, band, value, 1.0);
      if (of_trace && of_carriers) errors[band].*value = std::hypot(*of_trace, *of_carriers);
    }
  return errors;
}

/// Batches of the late field of a response that was gathered from `field`.
LateBatches batches_of_field(const AcousticScene& acoustics, const EarlyCandidates& candidates, const SourceField& field,
                             glm::vec3 listener, const EnergyResponse& response) {
  EnergyHistogram exact = make_histogram(acoustics), gathered = exact;  // of images; of images and photons
  if (candidates.long_chains()) candidates.long_chains()->add_late(acoustics, listener, exact);
  field.gather(acoustics, listener, gathered);
  EnergyHistogram scattered(response.late.num_bins(), response.late.num_bands(), 0, response.late.bin_s());
  add_scattered_energy(response.scattered, response.speed_of_sound_m_per_s, scattered);
  FieldBatches parts = field_batches(acoustics, candidates, field, listener);
  LateBatches batches;
  batches.count = parts.count;
  batches.num_bins = response.late.num_bins();
  batches.num_bands = response.late.num_bands();
  batches.energy = std::move(parts.share);
  std::size_t at = 0;
  for (int batch = 0; batch < batches.count; ++batch)
    for (int bin = 0; bin < batches.num_bins; ++bin)
      for (int band = 0; band < batches.num_bands; ++band, ++at) {
        const float whole = gathered.energy(bin, band);
        const float of_photons = whole > 0 ? std::max(1 - exact.energy(bin, band) / whole, 0.f) : 0.f;
        const float late = std::max(response.late.energy(bin, band) - scattered.energy(bin, band), 0.f);
        batches.energy[at] = late * (1 + of_photons * (batches.energy[at] - 1));
      }
  return batches;
}

/// Parameters of a response from a field with cells of a given size, from the photons of the errors.
std::vector<BandMetrics> measure_in_cells(const AcousticScene& acoustics, const EarlyCandidates& candidates, std::uint64_t photons,
                                          glm::vec3 listener, float cell_m) {
  AcousticConfig config = acoustics.config();
  config.field_cell_m = cell_m;
  const AcousticScene scene(AcousticSurfaces(acoustics.shared_scene(), config, acoustics.surfaces().found()), acoustics.plan());
  EnergyResponse response;
  compute_energy_response(scene, candidates, build_source_field_of(scene, candidates, photons).get(), listener, response);
  return measure(scene, response).bands;
}

/// With a field: the spread of its photons at the listener, in quadrature with what cells of half the size change for the same photons:
/// about as much again remains.  Cells of the least size have no finer ones.  Smaller cells are noisier by themselves, which is left out.
MetricErrors errors_of_field(const AcousticScene& acoustics, const EarlyCandidates& candidates, const SourceField& field,
                             glm::vec3 listener, const EnergyResponse& response) {
  EnergyResponse parts;
  parts.arrivals = response.arrivals;
  parts.late = response.late;
  parts.scattered = response.scattered;
  parts.speed_of_sound_m_per_s = response.speed_of_sound_m_per_s;
  parts.air = response.air;
  parts.batches = batches_of_field(acoustics, candidates, field, listener, response);
  std::vector<BandErrors> errors = late_errors(acoustics, parts);

  const std::uint64_t photons = std::min(field.photons(), kMostPhotonsOfErrors);
  const float cell_m = acoustics.config().field_cell_m, finer_m = std::max(kFinerCells * cell_m, kLeastCellM);
  if (!(finer_m < cell_m)) return {.bands = errors_of_batches(errors), .ears = {}, .sti = std::nullopt};
  const std::vector<BandMetrics> here =
      photons == field.photons() ? measure(acoustics, response).bands : measure_in_cells(acoustics, candidates, photons, listener, cell_m);
  const std::vector<BandMetrics> finer = measure_in_cells(acoustics, candidates, photons, listener, finer_m);
  for (std::size_t band = 0; band < errors.size(); ++band)
    for (const ErrorEntry& entry : kErrorEntries) {
      const auto &value = here[band].*entry.value, &of_finer = finer[band].*entry.value;
      std::optional<double>& error = errors[band].*entry.error;
      if (!error || !value || !of_finer) continue;
      const double change = *value - *of_finer, noise = kNoiseOfCells * *error;
      error = std::sqrt(*error * *error + std::max(change * change - noise * noise, 0.0));
    }
  return {.bands = errors_of_batches(errors), .ears = {}, .sti = std::nullopt};
}

}  // namespace

MetricErrors standard_errors(const AcousticScene& acoustics, const EarlyCandidates& candidates, const SourceField* field,
                             glm::vec3 listener, const EnergyResponse& response, const ParameterRequest& request,
                             const RenderEars& render_ears) {
  if (field != nullptr) return errors_of_field(acoustics, candidates, *field, listener, response);
  MetricErrors errors{.bands = errors_of_batches(late_errors(acoustics, response)), .ears = {}, .sti = std::nullopt};
  const bool has_batches = !errors.bands.empty();
  if ((has_batches && !request.any()) || acoustics.config().rays < kRepetitions || acoustics.config().late == Switch::off) return errors;

  const bool with_ears = request.interaural && render_ears;
  const RoomMetrics of_response = measure(acoustics, response);
  const std::vector<BandMetrics>& measured = of_response.bands;
  const double delay_s = of_response.first_arrival_s.value_or(0.0);
  BandDraws repeated, traced;
  RepeatedTraces traces;
  std::vector<double> sti;
  // A bidirectional trace has rays from the source too, which no part of its rays from the listener tells of: it is repeated whole.
  const int rays = acoustics.config().rays / (has_batches ? 1 : kRepetitions);
  const double factor = has_batches ? 1.0 : 1.0 / std::sqrt(double{kRepetitions});  // a trace with all rays spreads less
  repeat_trace(acoustics, candidates, listener, rays, [&](const AcousticScene& scene, const EnergyResponse& of_part) {
    if (!has_batches) traces.add(of_part);
    RoomMetrics metrics = measure(scene, of_part, request);
    repeated.push_back(std::move(metrics.bands));
    if (metrics.sti) sti.push_back(*metrics.sti);
    if (!with_ears) return;
    Rir ears;
    render_ears(of_part, 0, ears);
    traced.push_back(correlations(acoustics.config(), ears, delay_s));
  });
  std::vector<BandMetrics> better;
  if (!has_batches) {
    errors.bands = errors_of_batches(late_errors(acoustics, traces.together));
    better = may_be_biased(acoustics, response) ? trace_without_bias(acoustics, candidates, listener)
                                                : trace_with_many_rays(acoustics, candidates, listener);
  }
  errors.sti = spread_of_draws(sti);
  if (errors.sti) *errors.sti *= factor;
  for (std::size_t band = 0; band < errors.bands.size(); ++band) {
    // Both methods overstate where a parameter is no smooth function of the energies: EDT of eight rays between two walls is at times ten
    // times that of 64, and a strong ray of one trace may bend the decay of all eight.
    const auto set_with_bias = [&](BandValue value) {
      std::optional<double>& error = errors.bands[band].*value;
      const std::optional<double> of_draws = error_of_draws(repeated, band, value, factor);
      if (!of_draws || !error || *of_draws < *error) error = of_draws;  // fewer than four traces with a value: none
      if (error && better[band].*value && measured[band].*value)
        error = std::hypot(*error, kOfDifference * (*(measured[band].*value) - *(better[band].*value)));
    };
    if (!has_batches) {
      set_with_bias(&BandMetrics::rt60_s);
      for (const ErrorEntry& entry : kErrorEntries) set_with_bias(entry.value);
    }
    for (const RequestedMetricKey& entry : kRequestedMetricKeys)
      if (request.*entry.group) errors.bands[band].*entry.value = error_of_draws(repeated, band, entry.value, factor);
  }
  if (with_ears) errors.ears = interaural_errors(acoustics.config(), response, delay_s, render_ears, traced, factor);
  return errors;
}

}  // namespace earshot
