// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/accuracy/accuracy_reference.h"

#include <algorithm>
#include <utility>

#include "sim/base/random.h"

namespace earshot {
namespace {

AcousticConfig unbiased(const AcousticConfig& config) {
  const AcousticConfig high = acoustic_preset("high");
  AcousticConfig reference = config;
  reference.early_order = high.early_order;
  reference.early_candidate_rays = high.early_candidate_rays;
  reference.diffraction_reflections = high.diffraction_reflections;
  reference.rays = 512;
  reference.source_rays = 128;
  reference.source_bounces = high.source_bounces;
  reference.max_bounces = high.max_bounces;
  reference.diffuse_last_segment = false;
  reference.field = Switch::off;
  reference.sh_order = 0;
  reference.threads = 0;  // the bits are the same
  return reference;
}

}  // namespace

AccuracyReference::AccuracyReference(const std::shared_ptr<const Scene>& scene, const AcousticConfig& config, const SoundSource& source,
                                     std::vector<glm::vec3> places)
    : scene_(scene, unbiased(config)), candidates_(scene_, source), places_(std::move(places)) {
  for (auto& half : halves_) half.resize(places_.size());
}

void AccuracyReference::run() {
  const auto words = RandomStream(scene_.config().seed, Purpose::calibration).bits4(static_cast<std::uint32_t>(runs_));
  const AcousticScene seeded = scene_.with_rays(scene_.config().rays, (std::uint64_t{words[0]} << 32) | words[1]);
  EnergyResponse response;
  for (std::size_t place = 0; place < places_.size(); ++place) {
    EnergyResponse& sum = halves_[static_cast<std::size_t>(runs_ % 2)][place];
    compute_energy_response(seeded, candidates_, places_[place], response);
    if (runs_ < 2) {
      sum = response;
    } else {
      sum.late.add(response.late);
    }
  }
  ++runs_;
}

void AccuracyReference::refine(const AccuracyTarget& target, double most, int max_runs,
                               const std::function<void(double fraction)>& progress) {
  constexpr int least_runs = 4;
  while (runs_ < max_runs) {
    const int until = std::min(std::max(2 * runs_, least_runs), max_runs);
    while (runs_ < until) {
      run();
      if (progress) progress(static_cast<double>(runs_) / max_runs);
    }
    for (std::size_t half = 0; half < 2; ++half) {
      const int in_half = (runs_ + 1 - static_cast<int>(half)) / 2;
      readings_[half].clear();
      for (EnergyResponse mean : halves_[half]) {
        mean.late.scale(1.f / static_cast<float>(in_half));
        readings_[half].push_back(read_accuracy(scene_, mean));
      }
    }
    standard_error_ = half_difference(readings_[0], readings_[1]);
    if (target.used(standard_error_) <= most) return;
  }
}

}  // namespace earshot
