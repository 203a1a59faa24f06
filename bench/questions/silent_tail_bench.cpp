// SPDX-License-Identifier: Apache-2.0
// Question: does a step cost more when the sound and the room die away through the denormals than when there is noise?
// (docs/evidence/stability.md, H-39)

#include <benchmark/benchmark.h>

#include <cmath>
#include <vector>

#include "sim/audio/stream/sound_stream.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

constexpr int kBlock = 2400, kTaps = 8000;
constexpr std::size_t kSamples = 160000;  // ten seconds

enum Sound { noise, dying, silence };

std::vector<float> samples_of(Sound sound, std::size_t count, double decay_samples) {
  const RandomStream random(1, Purpose::bench);
  std::vector<float> samples(count, 0.f);
  for (std::size_t i = 0; i < count && sound != silence; ++i) {
    const double envelope = sound == dying ? std::exp(-static_cast<double>(i) / decay_samples) : 1.0;
    samples[i] = static_cast<float>(envelope * (2.0 * static_cast<double>(random.uniform(static_cast<std::uint32_t>(i))) - 1.0));
  }
  return samples;
}

/// One step of a moving agent: a new RIR, the fade from the one before, two ears.
void BM_StreamStep(benchmark::State& state) {
  const auto sound = static_cast<Sound>(state.range(0));
  const SoundClip clip{.name = "bench", .sample_rate_hz = 16000.f, .samples = samples_of(sound, kSamples, 1500)};
  // A dying room's last taps are 1e-39 and less.
  const std::vector<float> rir = samples_of(sound == noise ? noise : dying, 2 * kTaps, 80), before(rir.rbegin(), rir.rend());
  StreamConvolver convolver({.max_rir_samples = kTaps, .max_block_samples = kBlock}, 2);
  std::vector<float> out(2 * kBlock);
  StreamPosition position;
  for (auto _ : state) {
    convolver.convolve(clip, position, rir, before, kTaps, kBlock, out);
    benchmark::DoNotOptimize(out.data());
    position.sample += kBlock;
  }
  state.counters["steps_per_s"] = benchmark::Counter(static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
}
BENCHMARK(BM_StreamStep)->ArgName("noise0_dying1_silence2")->Arg(noise)->Arg(dying)->Arg(silence)->Repetitions(5)->ReportAggregatesOnly();

}  // namespace
}  // namespace earshot
