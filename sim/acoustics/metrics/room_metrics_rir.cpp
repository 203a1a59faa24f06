// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <numeric>

#include "sim/acoustics/core/bands.h"
#include "sim/acoustics/metrics/band_analysis.h"
#include "sim/acoustics/metrics/interaural.h"
#include "sim/acoustics/metrics/noise_tail.h"
#include "sim/acoustics/metrics/onset.h"
#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/metrics/signal_energy.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

/// Of minutes of response the first 20 s and more decide: the rest is 20 dB and more below, or noise.
constexpr std::size_t kMaxInterauralSamples = std::size_t{1} << 21;

BandLayout layout_of(const RirMeasurement& how, float sample_rate_hz) {
  return how.bands == MeasuredBands::octaves ? BandLayout::octaves(sample_rate_hz, how.low_octave)
                                             : BandLayout::third_octaves(sample_rate_hz);
}
/// Of the edges of the filters, octaves: a half of the bandwidth is one edge.
double half_width_of(MeasuredBands bands) { return bands == MeasuredBands::octaves ? 0.25 : 1.0 / 12; }

bool has_reference(const RirMeasurement& how) { return how.is_green || !how.reference_10m.empty(); }

void add_missing(const RirMeasurement& how, double length_s, std::vector<MissingParameter>& missing) {
  constexpr const char* kNeedsReference = "needs a strength reference: the response at 10 m in a free field, or samples in Green units";
  if (!has_reference(how)) missing.push_back({"g_db", kNeedsReference});
  if (how.request.lateral && how.lateral.empty())
    for (const char* key : {"j_lf", "j_lfc", "lg_db"}) missing.push_back({key, "needs the response of a figure-of-eight microphone"});
  else if (how.request.lateral && !has_reference(how))
    missing.push_back({"lg_db", kNeedsReference});
  if (how.request.lateral) add_missing_lateral(length_s, missing);
  if (how.request.stage) add_missing_stage({how.has_direct, how.distance_m, length_s}, missing);
}

/// Parameters of one band that are on request, but those of speech.
void add_requested(const RirMeasurement& how, const BandSignals& signals, double reference, std::span<const MissingParameter> missing,
                   BandMetrics& band) {
  const BandEnergy all{signals.after_direct, kMeasuredBinS, signals.direct_energy};
  if (how.request.lateral && !how.lateral.empty()) {
    // Both microphones have the whole response here: the direct sound counts where the filter puts it.
    const BandEnergy whole{signals.whole, kMeasuredBinS, 0.0};
    if (!is_missing(missing, "j_lf")) band.j_lf = lateral_fraction(signals.lateral, whole);
    if (!is_missing(missing, "j_lfc")) band.j_lfc = lateral_fraction(signals.product, whole);
    if (!is_missing(missing, "lg_db")) band.lg_db = late_lateral_strength_db(signals.lateral, kMeasuredBinS, reference);
  }
  if (how.request.stage) add_stage_support(all, missing, band);
}

void leave_out_noise(BandSignals& signals) {
  const std::optional<NoiseCut> cut = find_noise(signals.whole, kMeasuredBinS);
  if (!cut) return;
  replace_noise(*cut, signals.whole);
  replace_noise(*cut, signals.after_direct);
  // From the same bin on, so that lateral fractions are not noise over a clean whole.  Nothing in its place is enough for energies: the
  // decay there has as little of the whole as the noise is below the response.
  for (std::vector<double>* const signal : {&signals.lateral, &signals.product})
    if (signal->size() > cut->bin) std::fill(signal->begin() + static_cast<std::ptrdiff_t>(cut->bin), signal->end(), 0.0);
}

double onset_s(std::span<const float> samples, double rate) { return static_cast<double>(find_onset(samples, rate).value_or(0)) / rate; }

}  // namespace

RoomMetrics measure(std::span<const float> rir, float sample_rate_hz, const RirMeasurement& how) {
  check_measurement(rir, sample_rate_hz, how);
  const double rate = sample_rate_hz, delay_s = how.direct_delay_s ? *how.direct_delay_s : onset_s(rir, rate);
  const BandLayout bands = layout_of(how, sample_rate_hz);
  RoomMetrics metrics;
  metrics.bands_hz = bands.centre_hz;
  if (!(energy_of(rir) > 0)) {
    metrics.bands.resize(metrics.bands_hz.size());
    add_missing_silent(how.request, metrics.missing);
    return metrics;
  }
  add_missing(how, static_cast<double>(rir.size()) / rate - delay_s, metrics.missing);

  BandAnalysis analysis(rir, how.lateral, bands, half_width_of(how.bands), rate, delay_s, how.has_direct);
  std::optional<BandAnalysis> of_reference;
  if (!how.reference_10m.empty())
    of_reference.emplace(how.reference_10m, std::span<const float>{}, bands, half_width_of(how.bands), rate, 0.0);
  std::vector<std::vector<double>> whole;
  for (int band = 0; band < bands.size(); ++band) {
    BandSignals signals = analysis.filter_band(band);
    if (how.without_noise) leave_out_noise(signals);
    if (how.request.speech) whole.push_back(signals.whole);
    BandMetrics& of_band = metrics.bands.emplace_back();
    if (signals.after_direct.empty()) continue;
    of_band = measure_band(signals.after_direct, kMeasuredBinS, signals.direct_energy, signals.whole);
    double reference = kFreeField10m;
    if (of_reference) {
      const std::vector<double> free_field = of_reference->filter_band(band).whole;
      reference = std::accumulate(free_field.begin(), free_field.end(), 0.0);
      if (of_band.g_db) of_band.g_db = level_ratio_db(kFreeField10m * std::pow(10.0, 0.1 * *of_band.g_db), reference);
    }
    if (!has_reference(how)) of_band.g_db.reset();
    add_requested(how, signals, reference, metrics.missing, of_band);
  }
  add_missing_bands(how.request, metrics.bands_hz, metrics.bands, metrics.missing);
  if (how.request.speech)
    metrics.sti = add_speech_transmission(how.request, metrics.bands_hz, whole, std::vector<double>(whole.size(), 0.0), kMeasuredBinS,
                                          metrics.bands, metrics.missing);

  if (analysis.direct_energy() > 0) {
    metrics.direct_delay_s = delay_s;
    metrics.direct_amplitude = std::sqrt(analysis.direct_energy());
    if (analysis.rest_energy() > 0) metrics.drr_db = 10.0 * std::log10(analysis.direct_energy() / analysis.rest_energy());
  }
  return metrics;
}

RoomMetrics measure(std::span<const float> rir, float sample_rate_hz, double direct_delay_s) {
  return measure(rir, sample_rate_hz, RirMeasurement{.direct_delay_s = direct_delay_s, .is_green = true});
}

RoomMetrics measure(const Rir& rir, const RirMeasurement& how) {
  require(rir.num_channels >= 1, "channels", rir.num_channels, "must be at least one");
  RoomMetrics metrics = measure(rir.channel(0), rir.sample_rate_hz, how);
  if (rir.num_channels != 2) return metrics;
  const std::vector<BandMetrics> interaural = measure_interaural(rir, how);
  for (std::size_t band = 0; band < interaural.size(); ++band) {
    BandMetrics& of_band = metrics.bands[band];
    of_band.iacc = interaural[band].iacc;
    of_band.iacc_early = interaural[band].iacc_early;
    of_band.iacc_late = interaural[band].iacc_late;
  }
  return metrics;
}

RoomMetrics measure(const Rir& rir, double direct_delay_s) {
  return measure(rir, RirMeasurement{.direct_delay_s = direct_delay_s, .is_green = true});
}

std::vector<BandMetrics> measure_interaural(const Rir& rir, const RirMeasurement& how) {
  require(rir.num_channels == 2, "channels", rir.num_channels, "must be two");
  const double rate = static_cast<double>(rir.sample_rate_hz);
  const double delay_s = how.direct_delay_s ? *how.direct_delay_s : std::min(onset_s(rir.channel(0), rate), onset_s(rir.channel(1), rate));
  const BandLayout bands = layout_of(how, rir.sample_rate_hz);
  const std::size_t heard = std::min<std::size_t>(rir.channel(0).size(), kMaxInterauralSamples);
  std::vector<BandMetrics> found(static_cast<std::size_t>(bands.size()));
  for (int band = 0; band < bands.size(); ++band) {
    const InterauralCorrelation iacc = interaural_correlation(rir.channel(0).first(heard), rir.channel(1).first(heard), rir.sample_rate_hz,
                                                              delay_s, bands, band, half_width_of(how.bands));
    BandMetrics& of_band = found[static_cast<std::size_t>(band)];
    of_band.iacc = iacc.total, of_band.iacc_early = iacc.early, of_band.iacc_late = iacc.late;
  }
  return found;
}

}  // namespace earshot
