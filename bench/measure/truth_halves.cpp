// SPDX-License-Identifier: Apache-2.0
#include "bench/measure/truth_halves.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "sim/acoustics/accuracy/cross_validation.h"
#include "sim/base/random.h"
#include "sim/base/stopwatch.h"

namespace earshot {
namespace {

AcousticConfig truth_config(int rays) {
  AcousticConfig config = acoustic_preset("high");
  config.field = Switch::off;
  config.rir_length_s = 0;
  config.rays = rays;
  config.source_rays = std::max(rays / 4, 1);
  config.threads = 0;  // the bits are the same
  return config;
}

}  // namespace

TruthHalves::TruthHalves(std::shared_ptr<const Scene> scene, glm::vec3 source, std::vector<WalkPose> poses, int rays)
    : acoustics_(std::move(scene), truth_config(rays)), candidates_(acoustics_, source), poses_(std::move(poses)) {
  for (auto& half : sums_) half.resize(poses_.size());
}

void TruthHalves::add_round() {
  const Stopwatch watch;
  const RandomStream seeds(acoustics_.config().seed, Purpose::bench);
  EnergyResponse run;
  for (std::size_t p = 0; p < poses_.size(); ++p)
    for (std::size_t half = 0; half < 2; ++half) {
      const auto words = seeds.bits4(static_cast<std::uint32_t>((static_cast<std::size_t>(rounds_) * poses_.size() + p) * 2 + half));
      const AcousticScene seeded = acoustics_.with_rays(acoustics_.config().rays, (std::uint64_t{words[0]} << 32) | words[1]);
      compute_energy_response(seeded, candidates_, poses_[p].ears(), run);
      EnergyResponse& sum = sums_[half][p];
      if (rounds_ == 0) {
        sum = run;
        sum.batches.clear();  // errors come from the halves
        sum.memory = {};
      } else {
        sum.late.add(run.late);
      }
    }
  ++rounds_;
  seconds_ += watch.wall_s();
}

EnergyResponse TruthHalves::half(std::size_t pose, int which) const {
  EnergyResponse response = sums_[static_cast<std::size_t>(which)][pose];
  response.late.scale(1.f / static_cast<float>(rounds_));
  return response;
}

EnergyResponse TruthHalves::mean(std::size_t pose) const {
  EnergyResponse response = sums_[0][pose];
  response.late.add(sums_[1][pose].late);
  response.late.scale(0.5f / static_cast<float>(rounds_));
  return response;
}

double TruthHalves::t20_error() const {
  PlaceMean squares(poses_.size());
  for (std::size_t p = 0; p < poses_.size(); ++p) {
    const RoomMetrics first_half = measure(acoustics_, half(p, 0)), second_half = measure(acoustics_, half(p, 1));
    for (std::size_t b = 0; b < first_half.bands.size(); ++b)
      if (first_half.bands[b].t20_s && second_half.bands[b].t20_s && *first_half.bands[b].t20_s > 0) {
        const double difference =
            (*first_half.bands[b].t20_s - *second_half.bands[b].t20_s) / (*first_half.bands[b].t20_s + *second_half.bands[b].t20_s);
        squares.add(p, difference * difference);  // half the difference over the mean
      }
  }
  return root_mean_square(squares).value;
}

}  // namespace earshot
