// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "apps/options/timed_path.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/response/temporal_reuse.h"
#include "sim/acoustics/source_field/refining_field.h"
#include "sim/acoustics/source_field/source_field_store.h"
#include "sim/acoustics/synthesis/path_glide.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/audio/stream/sound_stream.h"

namespace earshot {

/// How the late sound of a source of a walk is found.
enum class WalkLateSound {
  traced,    ///< at each pose, for itself
  reused,    ///< traced, and blended along the walk
  gathered,  ///< from a field that is complete before the walk begins
  refined,   ///< from a field that gets better while the walk goes on, by a fixed schedule
};

/// A source before its sound is rendered.
struct WalkSourceSetup {
  std::vector<TimedPose> path;
  SoundSource at_start;
  bool moving = false;
  WalkLateSound late = WalkLateSound::traced;
  int refine_every = 0;  ///< blocks, with WalkLateSound::refined
  SoundClip clip;
  std::uint64_t scene_hash = 0;  ///< with at_start.position the key of its noise, that of `earshot rir`
};

/// The listener at a moment of the walk.
struct WalkMoment {
  double t_s = 0;
  glm::vec3 listener{0};
  ListenerOrientation orientation;
};

/// The block of sound between two moments.
struct WalkBlock {
  std::size_t index = 0;
  int num_samples = 0;
};

/// One source of a walk with its response and convolver.  A source at rest keeps its candidates; a moving one
/// gets new ones where it was when it made what is heard.
class WalkSource {
 public:
  /// block_samples: of the longest block.
  WalkSource(WalkSourceSetup setup, int block_samples);

  /// Prepares the parts of a source at rest that do not depend on the pose.  Once, before begin().
  void prepare(const AcousticScene& acoustics, SourceFieldStore& fields);
  /// The moment at which the first block begins.  glider: made for blocks of block_samples.
  void begin(const AcousticScene& acoustics, RirSynthesizer& synthesizer, PathGlider& glider, const WalkMoment& start);
  /// Adds the sound of this source at the listener during the block, which leads from the last moment to `end`, to `mix`
  /// [channels, block.num_samples].
  void add_block(const AcousticScene& acoustics, RirSynthesizer& synthesizer, PathGlider& glider, const WalkMoment& end, WalkBlock block,
                 std::span<float> mix);

 private:
  /// Makes rir_ and the strong paths those of the moment, block.num_samples after the one before.
  void hear(const AcousticScene& acoustics, RirSynthesizer& synthesizer, PathGlider& glider, const WalkMoment& moment, WalkBlock block);
  void respond(const AcousticScene& acoustics, glm::vec3 listener, std::size_t block_index);

  std::vector<TimedPose> path_;
  SoundSource source_;
  bool moving_;
  WalkLateSound late_;
  int refine_every_, block_samples_;
  SoundClip clip_;
  OversampledSound oversampled_;
  std::uint64_t carrier_key_;
  std::unique_ptr<EarlyCandidates> candidates_;  // at a stable address: the refining thread reads it
  std::shared_ptr<const SourceField> field_;
  std::unique_ptr<RefiningField> refining_;
  TemporalReuse reuse_;
  EnergyResponse response_;
  std::optional<glm::vec3> responds_to_;
  Rir rir_, previous_;
  GlidingPaths gliding_;
  StreamPosition position_{0, 0, false};
  std::optional<StreamConvolver> convolver_;
  std::vector<float> part_;
};

}  // namespace earshot
