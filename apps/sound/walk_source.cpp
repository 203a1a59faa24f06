// SPDX-License-Identifier: Apache-2.0
#include "apps/sound/walk_source.h"

#include <algorithm>
#include <utility>

#include "apps/options/source_options.h"
#include "sim/acoustics/response/retarded_source.h"
#include "sim/acoustics/synthesis/carriers.h"
#include "sim/base/process/progress.h"

namespace earshot {

WalkSource::WalkSource(WalkSourceSetup setup, int block_samples)
    : path_(std::move(setup.path)),
      source_(std::move(setup.at_start)),
      moving_(setup.moving),
      late_(setup.late),
      refine_every_(setup.refine_every),
      block_samples_(block_samples),
      clip_(std::move(setup.clip)),
      oversampled_(clip_),
      carrier_key_(carrier_key(setup.scene_hash, source_.position)) {}

void WalkSource::prepare(const AcousticScene& acoustics, SourceFieldStore& fields) {
  if (moving_) return;
  candidates_ = std::make_unique<EarlyCandidates>(acoustics, source_);
  if (late_ == WalkLateSound::gathered) {
    Progress progress("source field", "%", 100);
    field_ = fields.get(acoustics, *candidates_, [&](double fraction) { progress.update(static_cast<std::uint64_t>(100 * fraction)); });
  } else if (late_ == WalkLateSound::refined) {
    refining_ = std::make_unique<RefiningField>(acoustics, *candidates_);
  }
}

void WalkSource::begin(const AcousticScene& acoustics, RirSynthesizer& synthesizer, PathGlider& glider, const WalkMoment& start) {
  hear(acoustics, synthesizer, glider, start, {.index = 0, .num_samples = block_samples_});
  convolver_.emplace(StreamConfig{rir_.sample_rate_hz, rir_.num_samples, block_samples_, block_samples_}, rir_.num_channels);
}

void WalkSource::add_block(const AcousticScene& acoustics, RirSynthesizer& synthesizer, PathGlider& glider, const WalkMoment& end,
                           WalkBlock block, std::span<float> mix) {
  const int samples = block.num_samples;
  std::swap(rir_, previous_);
  hear(acoustics, synthesizer, glider, end, block);
  part_.resize(static_cast<std::size_t>(samples) * static_cast<std::size_t>(rir_.num_channels));
  convolver_->convolve(clip_, position_, rir_.samples, previous_.samples, rir_.num_samples, samples, part_);
  glider.render(oversampled_, position_, samples, samples, gliding_, part_);
  for (std::size_t i = 0; i < part_.size(); ++i) mix[i] += part_[i];
  position_.sample += static_cast<std::uint64_t>(samples);
}

void WalkSource::hear(const AcousticScene& acoustics, RirSynthesizer& synthesizer, PathGlider& glider, const WalkMoment& moment,
                      WalkBlock block) {
  const SourcePlaceAt place = [this](double t_s) { return pose_at(path_, t_s).position; };
  double emitted_s = moment.t_s;
  if (moving_) {
    emitted_s = emission_time_s(place, moment.listener, moment.t_s, double{acoustics.speed_of_sound_m_per_s()});
    const TimedPose pose = pose_at(path_, emitted_s);
    source_.position = glm::vec3(pose.position);
    source_.orientation = orientation_of(pose.heading_deg, 0, 0);
    candidates_ = std::make_unique<EarlyCandidates>(acoustics, source_, SourceMotion::moves);
  }
  respond(acoustics, moment.listener, block.index);
  if (moving_) retard_arrivals(place, emitted_s, moment.t_s, response_);
  const std::span<const std::uint8_t> glides = glider.choose(response_, &gliding_);
  synthesizer.render(response_, moment.orientation,
                     {carrier_key_, moment.listener, moving_ ? std::optional(source_.position) : std::nullopt}, rir_, nullptr, glides);
  glider.advance(response_, glides, moment.orientation, gliding_, block.num_samples);
}

void WalkSource::respond(const AcousticScene& acoustics, glm::vec3 listener, std::size_t block_index) {
  if (late_ == WalkLateSound::reused) return reuse_.compute(acoustics, *candidates_, listener, response_);
  if (late_ == WalkLateSound::refined) {
    // Snapshot n from block n * refine_every on: the sound does not depend on the speed of the thread.
    auto snapshot =
        refining_->wait_for(static_cast<int>(std::min<std::size_t>(block_index / static_cast<std::size_t>(refine_every_), 1000)));
    if (snapshot != field_) responds_to_.reset();
    field_ = std::move(snapshot);
  }
  if (!moving_ && responds_to_ == listener) return;  // turned in place, or at rest
  compute_energy_response(acoustics, *candidates_, field_.get(), listener, response_);
  responds_to_ = listener;
}

}  // namespace earshot
