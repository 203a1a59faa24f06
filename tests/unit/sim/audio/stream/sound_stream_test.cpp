// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/stream/sound_stream.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numbers>
#include <span>

#include "sim/base/errors.h"
#include "tests/support/acoustics/stream_sounds.h"

namespace earshot {
namespace {

using namespace stream_sounds;

/// The definition in double: sum over k of rir[k] dry(n - k), dry the endless loop.
double expected_sample(const SoundClip& clip, const StreamPosition& start, std::span<const float> rir, std::int64_t n) {
  const auto length = static_cast<std::int64_t>(clip.samples.size());
  std::int64_t index = (n + static_cast<std::int64_t>(start.clip_offset)) % length;
  double sum = 0;
  for (std::int64_t k = 0; k < static_cast<std::int64_t>(rir.size()); ++k) {
    if (n - k < static_cast<std::int64_t>(start.begin) && !start.already_playing) break;
    if (n - k < 0 || static_cast<std::uint64_t>(n - k) < start.end) sum += static_cast<double>(rir[k]) * clip.samples[index];
    index = index == 0 ? length - 1 : index - 1;
  }
  return sum;
}

struct Case {
  const char* name;
  std::size_t clip;
  int taps, block;
  bool already_playing;
};

class SoundStreamCase : public ::testing::TestWithParam<Case> {};

// A still agent hears one long convolution of the periodic sound, over sixty steps and many loop points.
TEST_P(SoundStreamCase, EqualsOneLongConvolution) {
  const Case& c = GetParam();
  const SoundClip clip = clip_of(noise(c.clip, 1));
  const auto rir = stereo_rir(c.taps, 2);
  StreamConvolver convolver({.max_rir_samples = 8000, .max_block_samples = 2400}, 2);
  StreamPosition position{.sample = 0, .clip_offset = 11, .already_playing = c.already_playing};
  std::vector<float> block(2 * static_cast<std::size_t>(c.block));
  double worst = 0, peak = 0;
  for (int step = 0; step < 60; ++step) {
    convolver.convolve(clip, position, rir, rir, c.taps, c.block, block);
    // A comb that holds the first and the last sample of each step.
    const int stride = std::max(1, (c.block - 1) / 12);
    for (int i = 0; i < c.block; i += stride) {
      for (int channel = 0; channel < 2; ++channel) {
        const auto taps = std::span(rir).subspan(static_cast<std::size_t>(channel * c.taps), static_cast<std::size_t>(c.taps));
        for (const int sample : {i, c.block - 1 - i}) {
          const double expected = expected_sample(clip, {.clip_offset = 11, .already_playing = c.already_playing}, taps,
                                                  static_cast<std::int64_t>(position.sample) + sample);
          worst = std::max(worst, std::abs(block[static_cast<std::size_t>(channel * c.block + sample)] - expected));
          peak = std::max(peak, std::abs(expected));
        }
      }
    }
    position.sample += static_cast<std::uint64_t>(c.block);
  }
  EXPECT_LT(worst, 1e-5 * peak);  // promised; float transforms of 8192 give about 1e-6
  EXPECT_GT(peak, 0);
}

// A sound that begins and ends within blocks: silence before, and afterwards what the response still brings.
TEST(SoundStream, ASoundThatBeginsAndEndsRingsOn) {
  constexpr int kTaps = 3000, kBlock = 2400;
  const SoundClip clip = clip_of(noise(1700, 1));
  const auto rir = stereo_rir(kTaps, 2);
  const StreamConfig config{.max_rir_samples = 8000, .max_block_samples = kBlock};
  const auto shared = std::make_shared<DrySpectra>(StreamConvolver::plan(config, 2).fft_size, std::size_t{1} << 24);
  StreamConvolver convolver(config, 2, shared);
  RirSpectra spectra;
  convolver.transform(rir, kTaps, spectra);
  for (const auto& [begin, end] : {std::pair<std::uint64_t, std::uint64_t>{0, 5000}, {3001, 9999}, {2400, 2401}, {5000, 5000}}) {
    StreamPosition position{.clip_offset = 11, .already_playing = false, .begin = begin, .end = end};
    std::vector<float> block(2 * kBlock);
    double worst = 0, peak = 0;
    for (int step = 0; step < 7; ++step) {
      convolver.convolve(clip, 99, position, spectra, nullptr, kBlock, block);
      for (int i = 0; i < kBlock; i += 7) {
        const double expected =
            expected_sample(clip, position, std::span(rir).first(kTaps), static_cast<std::int64_t>(position.sample) + i);
        worst = std::max(worst, std::abs(block[static_cast<std::size_t>(i)] - expected));
        peak = std::max(peak, std::abs(expected));
      }
      position.sample += kBlock;
    }
    EXPECT_LT(worst, 1e-5 * std::max(peak, 1e-3)) << begin << " " << end;
    EXPECT_EQ(peak > 0, end > begin);
    for (const float value : block) ASSERT_NEAR(value, 0, 1e-6);  // the last echo is over: 7 * 2400 > 9999 + 3000
  }
}

INSTANTIATE_TEST_SUITE_P(SoundStream, SoundStreamCase,
                         ::testing::Values(Case{"usual", 16000, 8000, 2400, true}, Case{"clip_shorter_than_block", 1000, 3000, 2400, true},
                                           Case{"clip_of_one_sample", 1, 700, 300, true}, Case{"clip_of_seven", 7, 8000, 2400, true},
                                           Case{"rir_longer_than_clip", 5000, 8000, 1234, true},
                                           Case{"from_silence", 5000, 8000, 1234, false}, Case{"short_blocks", 5000, 4000, 37, true},
                                           Case{"block_of_one", 900, 500, 1, true}, Case{"rir_of_one_tap", 5000, 1, 2400, true},
                                           Case{"short_clip_from_silence", 5, 2000, 777, false}),
                         [](const auto& test) { return test.param.name; });

// Each ear keeps its own tail, whichever of the two is the longer.
TEST(SoundStream, EarsMayEndAtDifferentTaps) {
  constexpr int kTaps = 3000, kBlock = 2400;
  const SoundClip clip = clip_of(noise(5000, 1));
  const StreamPosition position{.sample = 70000};
  for (const auto& ends : {std::array{1500, 2000}, std::array{2000, 1500}, std::array{1, 3000}, std::array{3000, 0}, std::array{0, 700}}) {
    auto rir = stereo_rir(kTaps, 2);
    for (std::size_t ear = 0; ear < 2; ++ear)
      std::fill_n(rir.begin() + static_cast<std::ptrdiff_t>(ear * kTaps) + ends[ear], kTaps - ends[ear], 0.f);
    StreamConvolver convolver({.max_rir_samples = kTaps, .max_block_samples = kBlock}, 2);
    std::vector<float> block(2 * kBlock);
    convolver.convolve(clip, position, rir, rir, kTaps, kBlock, block);
    for (std::size_t ear = 0; ear < 2; ++ear)
      for (int i = 0; i < kBlock; i += 37) {
        const auto taps = std::span(rir).subspan(ear * kTaps, kTaps);
        EXPECT_NEAR(block[ear * kBlock + static_cast<std::size_t>(i)], expected_sample(clip, position, taps, 70000 + i), 5e-4)
            << ends[0] << " and " << ends[1] << " taps, ear " << ear;  // peak about 20
      }
  }
}

TEST(SoundStream, SilenceBeforeTheStartIsExact) {
  const SoundClip clip = clip_of(noise(500, 1));
  std::vector<float> rir(100, 0.f);
  rir[40] = 1.f;
  StreamConvolver convolver({.max_rir_samples = 100, .max_block_samples = 64, .crossfade_samples = 0}, 1);
  std::vector<float> block(64);
  convolver.convolve(clip, {.already_playing = false}, rir, {}, 100, 64, block);
  for (int i = 0; i < 40; ++i) EXPECT_NEAR(block[i], 0.f, 1e-6f);
  for (int i = 40; i < 64; ++i) EXPECT_NEAR(block[i], clip.samples[i - 40], 1e-6f);
}

TEST(SoundStream, FirstSampleIsThePreviousRoomAndTheEndIsTheNewOne) {
  const SoundClip clip = clip_of(noise(5000, 1));
  const auto before = stereo_rir(3000, 2), now = stereo_rir(3000, 3);
  const StreamConfig config{.max_rir_samples = 3000, .max_block_samples = 2400, .crossfade_samples = 800};
  StreamConvolver convolver(config, 2);
  const StreamPosition position{.sample = 123456};
  std::vector<float> faded(4800), old_sound(4800), new_sound(4800);
  convolver.convolve(clip, position, now, before, 3000, 2400, faded);
  convolver.convolve(clip, position, before, {}, 3000, 2400, old_sound);
  convolver.convolve(clip, position, now, {}, 3000, 2400, new_sound);
  for (int channel = 0; channel < 2; ++channel) {
    for (int i = 0; i < 2400; ++i) {
      const std::size_t n = static_cast<std::size_t>(channel * 2400 + i);
      const double weight = std::min(1.0, i / 800.0);
      EXPECT_NEAR(faded[n], old_sound[n] + weight * (new_sound[n] - old_sound[n]), 2e-5) << i;  // peak about 20: 1e-6 of it
      if (i >= 800) {
        ASSERT_EQ(faded[n], new_sound[n]);
      }
    }
  }
}

TEST(SoundStream, IdenticalRirsFadeToTheBitsOfNoFade) {
  const SoundClip clip = clip_of(noise(5000, 1));
  const auto rir = stereo_rir(3000, 2);
  const std::vector<float> copy = rir;
  StreamConvolver convolver({.max_rir_samples = 3000}, 2);
  std::vector<float> faded(4800), plain(4800);
  convolver.convolve(clip, {.sample = 99}, rir, copy, 3000, 2400, faded);
  convolver.convolve(clip, {.sample = 99}, rir, {}, 3000, 2400, plain);
  EXPECT_EQ(faded, plain);
}

TEST(SoundStream, FadeLongerThanTheBlockIsClamped) {
  const SoundClip clip = clip_of(noise(5000, 1));
  const auto before = stereo_rir(500, 2), now = stereo_rir(500, 3);
  StreamConvolver clamped({.max_rir_samples = 500, .max_block_samples = 400, .crossfade_samples = 800}, 2);
  StreamConvolver exact({.max_rir_samples = 500, .max_block_samples = 400, .crossfade_samples = 100}, 2);
  for (const int block : {100, 1}) {
    std::vector<float> a(2 * static_cast<std::size_t>(block)), b(a.size());
    clamped.convolve(clip, {.sample = 7}, now, before, 500, block, a);
    exact.convolve(clip, {.sample = 7}, now, before, 500, block, b);
    EXPECT_EQ(a, b);
  }
}

// While the RIR changes, the sample-to-sample difference is bounded by that of the two still sounds plus the fade's own slope.
TEST(SoundStream, MovingAgentHearsNoJump) {
  std::vector<float> samples(4000);
  for (int i = 0; i < 4000; ++i)
    samples[i] = static_cast<float>(std::sin(2.0 * std::numbers::pi * 5.0 * i / 4000.0));  // 20 Hz: smooth, so jumps show
  const SoundClip clip = clip_of(std::move(samples));
  constexpr int block = 2400, fade = 800, taps = 600;
  StreamConvolver convolver({.max_rir_samples = taps, .max_block_samples = block, .crossfade_samples = fade}, 1);
  const auto rir_at = [](int step) {
    std::vector<float> rir(taps, 0.f);
    rir[static_cast<std::size_t>(10 + 3 * step)] = 1.f / static_cast<float>(1 + step % 5);  // delays and levels jump
    rir[static_cast<std::size_t>(300 - step)] = -0.5f;
    return rir;
  };
  StreamPosition position;
  std::vector<float> sound(block);
  float last = 0;
  double worst = 0;
  for (int step = 1; step < 60; ++step) {
    convolver.convolve(clip, position, rir_at(step), step == 1 ? std::vector<float>() : rir_at(step - 1), taps, block, sound);
    for (int i = 0; i < block; ++i) {
      if (step > 1 || i > 0) worst = std::max(worst, std::abs(static_cast<double>(sound[i]) - last));
      last = sound[i];
    }
    position.sample += block;
  }
  // |y| <= 1.5; each still sound moves by at most 1.5 * 2 pi 20 / 16000 per sample, the fade by at most |y - x| / fade <= 3 / 800.
  EXPECT_LT(worst, 1.5 * 2.0 * std::numbers::pi * 20.0 / 16000.0 + 3.0 / fade + 1e-5);
}

TEST(SoundStream, PositionStaysExactForAMillionSteps) {
  const SoundClip clip = clip_of(noise(4801, 1));
  const auto rir = noise(300, 2);
  StreamConvolver convolver({.max_rir_samples = 300, .max_block_samples = 2400}, 1);
  const std::uint64_t sample = 1000000ull * 2400ull;  // beyond 2^31; a float clock would be off by 128 samples
  std::vector<float> far(2400), near(2400);
  convolver.convolve(clip, {.sample = sample, .clip_offset = 5}, rir, {}, 300, 2400, far);
  convolver.convolve(clip, {.sample = 0, .clip_offset = 5 + sample % 4801}, rir, {}, 300, 2400, near);
  EXPECT_EQ(far, near);
  convolver.convolve(clip, {.sample = 0, .clip_offset = 5 + sample}, rir, {}, 300, 2400, near);  // offsets wrap
  EXPECT_EQ(far, near);
}

TEST(SoundStream, SilentClipGivesExactZeros) {
  StreamConvolver convolver({.max_rir_samples = 3000}, 2);
  const auto rir = stereo_rir(3000, 2), before = stereo_rir(3000, 3);
  std::vector<float> block(4800, 1.f);
  convolver.convolve(clip_of(noise(5000, 1)), {}, rir, {}, 3000, 2400, block);  // leaves scratch dirty
  convolver.convolve(clip_of(std::vector<float>(100, 0.f)), {}, rir, before, 3000, 2400, block);
  for (const float value : block) ASSERT_EQ(value, 0.f);
  convolver.convolve(clip_of(noise(5000, 1)), {}, std::vector<float>(6000, 0.f), {}, 3000, 2400, block);
  for (const float value : block) ASSERT_EQ(value, 0.f);
}

// Linear without thresholds: a source that is 2^66 times quieter gives the same bits, scaled (H-37).
TEST(SoundStream, ScalesByPowersOfTwoBitForBit) {
  const auto rir = stereo_rir(3000, 2), before = stereo_rir(3000, 3);
  const SoundClip clip = clip_of(noise(5000, 1));
  StreamConvolver convolver({.max_rir_samples = 3000}, 2);
  std::vector<float> block(4800), scaled(4800);
  convolver.convolve(clip, {.sample = 77}, rir, before, 3000, 2400, block);
  for (const float factor : {std::ldexp(1.f, 20), std::ldexp(1.f, -66)}) {
    SoundClip other = clip;
    for (float& value : other.samples) value *= factor;
    convolver.convolve(other, {.sample = 77}, rir, before, 3000, 2400, scaled);
    for (std::size_t i = 0; i < block.size(); ++i) ASSERT_EQ(scaled[i], block[i] * factor);
  }
}

TEST(SoundStream, ConvolversShareNothing) {
  const SoundClip clip = clip_of(noise(5000, 1)), other = clip_of(noise(300, 9));
  const auto rir = stereo_rir(3000, 2);
  StreamConvolver busy({.max_rir_samples = 3000}, 2), fresh({.max_rir_samples = 3000}, 2);
  std::vector<float> a(4800), b(4800);
  for (const int block : {1, 100, 2400}) busy.convolve(other, {.sample = 5}, rir, {}, 3000, block, a);
  busy.convolve(clip, {.sample = 77}, rir, {}, 3000, 2400, a);
  fresh.convolve(clip, {.sample = 77}, rir, {}, 3000, 2400, b);
  EXPECT_EQ(a, b);
}

// The second form, which transforms both RIRs itself, and responses of different lengths, of which the longer ends in zeros.
TEST(SoundStream, SpectraOfResponsesOfAnyLengthFade) {
  const SoundClip clip = clip_of(noise(5000, 1));
  StreamConvolver convolver({.max_rir_samples = 8000}, 2);
  const auto brief = stereo_rir(1300, 2), lasting = stereo_rir(8000, 3);
  std::vector<float> padded(16000, 0.f), by_spectra(4800), by_samples(4800);
  for (std::size_t channel = 0; channel < 2; ++channel)
    std::copy_n(brief.begin() + static_cast<std::ptrdiff_t>(channel * 1300), 1300,
                padded.begin() + static_cast<std::ptrdiff_t>(channel * 8000));
  RirSpectra of_brief, of_lasting;
  convolver.transform(brief, 1300, of_brief);
  convolver.transform(lasting, 8000, of_lasting);
  EXPECT_LT(of_brief.num_parts(), of_lasting.num_parts());
  convolver.convolve(clip, 0, {.sample = 5}, of_brief, &of_lasting, 2400, by_spectra);
  convolver.convolve(clip, {.sample = 5}, padded, lasting, 8000, 2400, by_samples);
  EXPECT_EQ(by_spectra, by_samples);
  convolver.convolve(clip, 0, {.sample = 5}, of_lasting, &of_brief, 2400, by_spectra);
  convolver.convolve(clip, {.sample = 5}, lasting, padded, 8000, 2400, by_samples);
  EXPECT_EQ(by_spectra, by_samples);
}

TEST(SoundStream, PlansFitTheirTransforms) {
  for (const int taps : {1, 100, 8000, 12800, 500000})
    for (const int block : {1, 37, 1024, 2400, 48000}) {
      const StreamPlan plan = StreamConvolver::plan({.max_rir_samples = taps, .max_block_samples = block}, 2);
      EXPECT_GE(plan.part, 1);
      EXPECT_GE(plan.piece, 1);
      EXPECT_LE(plan.part + plan.piece, plan.fft_size + 1);
    }
}

TEST(SoundStream, RefusesNonsense) {
  EXPECT_THROW(StreamConvolver({.max_rir_samples = 0}, 2), InputError);
  EXPECT_THROW(StreamConvolver({.max_block_samples = 0}, 2), InputError);
  EXPECT_THROW(StreamConvolver({.crossfade_samples = -1}, 2), InputError);
  EXPECT_THROW(StreamConvolver(StreamConfig{}, 0), InputError);
  EXPECT_THROW(StreamConvolver({.max_rir_samples = 3000}, 2, std::make_shared<DrySpectra>(1 << 16, 1)), InputError);  // of another plan
  EXPECT_THROW(DrySpectra(0, 1), InputError);
}

}  // namespace
}  // namespace earshot
