// SPDX-License-Identifier: Apache-2.0
// WAV, FLAC and OGG through libsndfile and the resampler.
#include <cmath>

#include "fuzz/fuzz_target.h"
#include "sim/audio/dry_sounds/sound_clip.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  static const fuzz::InputFile file("sound.wav");
  fuzz::expect_value_or_refusal([&] {
    const SoundClip clip = load_sound(file.write(fuzz::text_of(data, size)), 16000.f);
    for (const float sample : clip.samples)
      if (!std::isfinite(sample)) fuzz::report("a sample that is not finite", "");
  });
  return 0;
}
