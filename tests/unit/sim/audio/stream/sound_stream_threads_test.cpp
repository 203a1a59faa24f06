// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <memory>
#include <thread>
#include <utility>
#include <vector>

#include "sim/audio/stream/sound_stream.h"
#include "tests/support/acoustics/stream_sounds.h"

namespace earshot {
namespace {

using namespace stream_sounds;

/// Sixty steps of an agent that turns: every step has a RIR of its own.
std::vector<float> walk_of(StreamConvolver& convolver, const SoundClip& clip, std::uint64_t key, std::uint64_t offset) {
  constexpr int taps = 3000, block = 2400;
  RirSpectra now, before;
  std::vector<float> sound, part(2 * block);
  StreamPosition position{.clip_offset = offset};
  for (std::uint32_t step = 0; step < 60; ++step) {
    std::swap(now, before);
    convolver.transform(stereo_rir(taps, 2 + step % 5), taps, now);
    convolver.convolve(clip, key, position, now, step > 0 ? &before : nullptr, block, part);
    sound.insert(sound.end(), part.begin(), part.end());
    position.sample += block;
  }
  return sound;
}

// Sounds convolved before, the capacity and the use by several threads at once change no bit.
TEST(SoundStream, SharedDrySpectraChangeNoBitOnAnyThread) {
  const SoundClip clip = clip_of(noise(16000, 1)), other = clip_of(noise(4801, 9));
  const StreamConfig config{.max_rir_samples = 3000};
  StreamConvolver alone(config, 2);
  const std::vector<float> expected = walk_of(alone, clip, 0, 123), expected_other = walk_of(alone, other, 0, 7);
  const int size = StreamConvolver::plan(config, 2).fft_size;
  for (const std::size_t bytes : {std::size_t{1}, std::size_t{16} << 20}) {  // eight spectra, contended; plenty
    const auto shared = std::make_shared<DrySpectra>(size, bytes);
    std::vector<std::vector<float>> heard(4);
    {
      std::vector<std::jthread> threads;
      for (std::size_t i = 0; i < heard.size(); ++i)
        threads.emplace_back([&, i] {
          StreamConvolver convolver(config, 2, shared);
          heard[i] = i % 2 == 0 ? walk_of(convolver, clip, 1, 123) : walk_of(convolver, other, 2, 7);
        });
    }
    for (std::size_t i = 0; i < heard.size(); ++i) EXPECT_EQ(heard[i], i % 2 == 0 ? expected : expected_other) << i << ", " << bytes;
  }
}

}  // namespace
}  // namespace earshot
