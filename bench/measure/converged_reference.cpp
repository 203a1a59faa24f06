// SPDX-License-Identifier: Apache-2.0
#include "bench/measure/converged_reference.h"

#include <algorithm>
#include <cmath>

#include "sim/acoustics/metrics/energy_series.h"
#include "sim/acoustics/metrics/late_errors.h"
#include "sim/base/random.h"
#include "sim/base/stopwatch.h"

namespace earshot {
namespace {

constexpr int kWindowSamples = 16000;  // of the observation

/// Adds the batches of a further run.
void append(const LateBatches& run, LateBatches& all) {
  if (all.count == 0) {
    all = run;
    return;
  }
  // The possible energy of undetected chains falls with the number of rays; a run may follow one that those before did not.
  const auto before = static_cast<float>(all.count), now = static_cast<float>(run.count);
  for (std::size_t i = 0; i < all.unseen.size(); ++i)
    all.unseen[i] = std::max(before * all.unseen[i], now * run.unseen[i]) / (before + now);
  all.count += run.count;
  all.energy.insert(all.energy.end(), run.energy.begin(), run.energy.end());
}

std::vector<std::optional<double>> relative(const std::vector<BandErrors>& errors, const RoomMetrics& metrics, bool t30) {
  std::vector<std::optional<double>> errors_of_value(metrics.bands.size());
  for (std::size_t b = 0; b < errors.size(); ++b) {
    const auto& error_s = t30 ? errors[b].t30_error_s : errors[b].t20_error_s;
    const auto& value_s = t30 ? metrics.bands[b].t30_s : metrics.bands[b].t20_s;
    if (error_s && value_s && *value_s > 0) errors_of_value[b] = *error_s / *value_s;
  }
  return errors_of_value;
}

constexpr int kMinRuns = 2, kMaxRuns = 64;  // at a pose

/// The pose whose standard error falls most by a further run, which removes 1 / (2 runs) of it; the number of poses if all have enough
/// runs.
std::size_t worst_known(const std::vector<ConvergedPose>& truth) {
  std::size_t worst = truth.size();
  double most = -1;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    if (truth[i].runs >= kMaxRuns) continue;
    double sum = 0;
    for (const std::optional<double>& error : truth[i].t20_error) sum += error.value_or(1.0);
    if (sum / truth[i].runs > most) most = sum / truth[i].runs, worst = i;
  }
  return worst;
}

}  // namespace

std::shared_ptr<const SynthesisTables> binaural_tables(const AcousticScene& scene) {
  return make_synthesis_tables(scene.config(), scene.bands(), ListenerLayout(ChannelLayout::binaural),
                               Hrtf::rigid_sphere(scene.config().sample_rate_hz));
}

ResponseListener::ResponseListener(std::shared_ptr<const SynthesisTables> tables, float sample_rate_hz, int rir_samples)
    : synthesizer_(std::move(tables)),
      clip_(synthesize_sound("synth:speech", sample_rate_hz)),
      convolver_(
          {.sample_rate_hz = sample_rate_hz, .max_rir_samples = rir_samples, .max_block_samples = kWindowSamples, .crossfade_samples = 0},
          2),
      analyzer_({.sample_rate_hz = sample_rate_hz, .num_samples = kWindowSamples}),
      sound_(2 * kWindowSamples) {
  const SpectrogramConfig shape{.sample_rate_hz = sample_rate_hz, .num_samples = kWindowSamples};
  spectrogram_.resize(2 * static_cast<std::size_t>(shape.rows()) * static_cast<std::size_t>(shape.columns()));
}

HeardResponse ResponseListener::hear(const AcousticScene& scene, const EnergyResponse& response, double heading_rad,
                                     std::uint64_t carrier_key) {
  constexpr double bin_s = 0.004, longest_s = 4;
  HeardResponse heard;
  heard.energy = measure(scene, response);
  for (int band = 0; band < scene.num_bands(); ++band)
    heard.series.push_back(energy_series(response, band, bin_s, static_cast<int>(longest_s / bin_s)));
  synthesizer_.render(response, heading_rad, carrier_key, rir_);
  const double delay_s = response.arrivals.empty() ? 0.0 : response.arrivals.front().distance_m / response.speed_of_sound_m_per_s;
  Rir left{.num_channels = 1, .num_samples = rir_.num_samples, .sample_rate_hz = rir_.sample_rate_hz, .samples = {}};
  left.samples.assign(rir_.channel(0).begin(), rir_.channel(0).end());
  heard.rir = measure(left, delay_s);
  heard.ears = interaural_bands(rir_.channel(0), rir_.channel(1), rir_.sample_rate_hz, delay_s);
  // A standing listener: one response for the whole second, of a sound that has been playing before.
  convolver_.convolve(clip_, StreamPosition{}, rir_.samples, {}, rir_.num_samples, kWindowSamples, sound_);
  analyzer_.analyze(sound_, spectrogram_);
  heard.spectrogram = spectrogram_;
  return heard;
}

void add_errors(const AcousticScene& scene, ConvergedPose& pose) {
  const RoomMetrics metrics = measure(scene, pose.response);
  const std::vector<BandErrors> errors = late_errors(scene, pose.response);
  pose.t20_error = relative(errors, metrics, false);
  pose.t30_error = relative(errors, metrics, true);
}

std::vector<ConvergedPose> converge(const AcousticScene& high, const EarlyCandidates& candidates, const std::vector<WalkPose>& poses,
                                    double seconds, const std::function<void(double)>& progress) {
  std::vector<ConvergedPose> truth(poses.size());
  for (std::size_t i = 0; i < poses.size(); ++i) truth[i].pose = poses[i];
  const RandomStream seeds(high.config().seed, Purpose::bench);
  const Stopwatch watch;
  EnergyResponse run;
  const auto add_run = [&](std::size_t i) {
    // Independent paths from the source for each pose: their errors are not common to all.
    const auto words = seeds.bits4(static_cast<std::uint32_t>(i) * kMaxRuns + static_cast<std::uint32_t>(truth[i].runs));
    const AcousticScene seeded = high.with_rays(high.config().rays, (std::uint64_t{words[0]} << 32) | words[1]);
    compute_energy_response(seeded, candidates, poses[i].ears(), run);
    EnergyResponse& sum = truth[i].response;
    if (truth[i].runs == 0) {
      sum.arrivals = run.arrivals;  // deterministic: the same in every run
      sum.speed_of_sound_m_per_s = run.speed_of_sound_m_per_s;
      sum.air = run.air;
      sum.late = run.late;
      sum.stats = run.stats;
    } else {
      // The mean of all runs, as it stands: errors are estimated from it.
      sum.late.scale(static_cast<float>(truth[i].runs) / static_cast<float>(truth[i].runs + 1));
      run.late.scale(1.f / static_cast<float>(truth[i].runs + 1));
      sum.late.add(run.late);
    }
    append(run.batches, sum.batches);
    ++truth[i].runs;
  };
  const std::size_t least = kMinRuns * poses.size();
  for (std::size_t done = 0; done < least; ++done) {
    add_run(done % poses.size());
    if (progress) progress(std::min(static_cast<double>(done + 1) / static_cast<double>(least), watch.wall_s() / seconds));
  }
  for (ConvergedPose& pose : truth) add_errors(high, pose);
  while (watch.wall_s() < seconds) {
    const std::size_t next = worst_known(truth);
    if (next == truth.size()) break;
    add_run(next);
    add_errors(high, truth[next]);
    if (progress) progress(std::min(watch.wall_s() / seconds, 1.0));
  }
  return truth;
}

int count_runs(const std::vector<ConvergedPose>& truth) {
  int runs = 0;
  for (const ConvergedPose& pose : truth) runs += pose.runs;
  return runs;
}

double mean_t20_error(const std::vector<ConvergedPose>& truth) {
  double sum = 0;
  int count = 0;
  for (const ConvergedPose& pose : truth)
    for (const auto& error : pose.t20_error)
      if (error) sum += *error, ++count;
  return count > 0 ? sum / count : std::nan("");
}

}  // namespace earshot
