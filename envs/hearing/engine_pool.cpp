// SPDX-License-Identifier: Apache-2.0
#include "envs/hearing/engine_pool.h"

#include <algorithm>
#include <cmath>

namespace earshot {
namespace {

StreamConfig stream_config(const EnvConfig& config, int block_samples, int filter_samples) {
  const float rate_hz = config.acoustics.sample_rate_hz;
  return {.sample_rate_hz = rate_hz,
          .max_rir_samples = static_cast<int>(std::ceil(config.acoustics.rir_length_s * rate_hz)) + filter_samples,
          .max_block_samples = block_samples,
          .crossfade_samples = std::min(block_samples, static_cast<int>(std::lround(config.crossfade_s * rate_hz)))};
}

}  // namespace

EnginePool::EnginePool(const EnvConfig& config, int block_samples) {
  if (!config.observation.hears()) return;
  const float rate_hz = config.acoustics.sample_rate_hz;
  std::shared_ptr<const Hrtf> hrtf;
  if (config.observation.has_ears()) hrtf = config.hrtf.empty() ? Hrtf::rigid_sphere(rate_hz) : Hrtf::from_sofa(config.hrtf, rate_hz);
  const auto tables = make_synthesis_tables(config.acoustics, bands_of(config.acoustics), config.observation.layout(), hrtf);
  const StreamConfig stream = stream_config(config, block_samples, hrtf ? hrtf->fft_size() : 0);
  const auto dry_spectra = make_dry_spectra(stream, config.observation.layout().num_channels());
  const double most_speed_m_per_s = std::max(5.0, 2.0 * static_cast<double>(config.task.forward_m / config.task.step_time_s));
  make_ = [tables, stream, sound = config.observation.sound, dry_spectra, most_speed_m_per_s] {
    return std::make_unique<HearingEngines>(tables, stream, sound, dry_spectra, most_speed_m_per_s);
  };
}

void EnginePool::resize(std::size_t workers, std::size_t helpers) {
  workers_.resize(workers);
  helpers_.resize(helpers);
}

}  // namespace earshot
