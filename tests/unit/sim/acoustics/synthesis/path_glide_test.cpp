// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/synthesis/path_glide.h"

#include <gtest/gtest.h>

#include <functional>
#include <glm/geometric.hpp>
#include <numbers>
#include <optional>

#include "sim/audio/stream/sound_stream.h"
#include "tests/support/acoustics/band_levels.h"
#include "tests/support/acoustics/synthesis_cases.h"

namespace earshot {
namespace {

using namespace synthesis_cases;
using namespace band_levels;

constexpr float kRateHz = 16000;
constexpr float kSpeed = 343;

struct Heard {
  EnergyResponse response;
  double heading_rad = 0;
};

/// Sound of num_blocks blocks as walk and environments make it, [channels][samples]; at(i): what is heard at the end of block i.
std::vector<std::vector<float>> stream(std::shared_ptr<const SynthesisTables> tables, const SoundClip& clip, int block, int fade,
                                       int num_blocks, const std::function<Heard(int)>& at) {
  RirSynthesizer synthesizer(tables);
  PathGlider glider(tables, block);
  const OversampledSound sound(clip);
  GlidingPaths paths;
  Rir now, before;
  StreamPosition position;
  std::optional<StreamConvolver> convolver;
  std::vector<std::vector<float>> result;
  std::vector<float> out;
  for (int i = 0; i < num_blocks; ++i) {
    const Heard heard = at(i);
    const auto glides = glider.choose(heard.response);
    synthesizer.render(heard.response, heard.heading_rad, 0, now, nullptr, glides);
    glider.advance(heard.response, glides, heard.heading_rad, paths);
    if (!convolver) convolver.emplace(StreamConfig{kRateHz, now.num_samples, block, fade}, now.num_channels);
    const auto channels = static_cast<std::size_t>(now.num_channels), width = static_cast<std::size_t>(block);
    out.resize(channels * width);
    result.resize(channels);
    convolver->convolve(clip, position, now.samples, before.samples, now.num_samples, block, out);
    glider.render(sound, position, block, fade, paths, out);
    for (std::size_t c = 0; c < channels; ++c)
      result[c].insert(result[c].end(), out.begin() + static_cast<std::ptrdiff_t>(c * width),
                       out.begin() + static_cast<std::ptrdiff_t>((c + 1) * width));
    position.sample += width;
    std::swap(now, before);
  }
  return result;
}

std::shared_ptr<const SynthesisTables> mono_tables(int glide_paths = 3) {
  AcousticConfig config = config_at(kRateHz);
  config.glide_paths = glide_paths;
  return make_synthesis_tables(config, BandLayout::octaves(kRateHz), ChannelLayout::mono, nullptr);
}

Heard direct_at(double distance_m, glm::vec3 direction = {0, 0, -1}, double heading_rad = 0) {
  Heard heard{.response = response_with({arrival_at(distance_m, 1.0 / (4.0 * std::numbers::pi * distance_m), direction)}),
              .heading_rad = heading_rad};
  heard.response.arrivals[0].identity = path_identity(ArrivalKind::direct, {});
  return heard;
}

/// Powers of the dry sound that a listener walking from `from_m` to `to_m` receives, by the inverse square law.
std::vector<double> expected_powers(const SoundClip& clip, std::size_t samples, double from_m, double to_m) {
  std::vector<float> heard(samples);
  for (std::size_t n = 0; n < samples; ++n) {
    const double r = from_m + (to_m - from_m) * static_cast<double>(n) / static_cast<double>(samples);
    const auto delay = static_cast<std::size_t>(std::lround(r / kSpeed * kRateHz));
    heard[n] = static_cast<float>(static_cast<double>(clip.samples[(n + clip.samples.size() - delay) % clip.samples.size()]) /
                                  (4.0 * std::numbers::pi * r));
  }
  return band_powers(heard, kRateHz);
}

class PathGlideSteps : public testing::TestWithParam<double> {};

// 1 m/s away from the source, mono: white noise keeps its level.  Two delays cross-faded lose 3.8 dB at steps of 0.05 s.  What noise does
// differently at the shifted pitch is within 0.2 dB in the narrowest band (23 Hz over 4 s, the same noise on both sides).
TEST_P(PathGlideSteps, WalkingAwayInTheFreeFieldKeepsTheLevelOfEveryBand) {
  const int block = static_cast<int>(std::lround(GetParam() * static_cast<double>(kRateHz)));
  const int num_blocks = static_cast<int>(std::lround(4.0 / GetParam()));
  const SoundClip clip = white_noise(5 * 16000 + 123, kRateHz, 1);
  const auto heard = stream(mono_tables(), clip, block, block / 3, num_blocks, [&](int i) { return direct_at(2.0 + GetParam() * i); });
  const auto samples = static_cast<std::size_t>(block * num_blocks);
  EXPECT_LT(worst_difference_db(band_powers(heard[0], kRateHz), expected_powers(clip, samples, 2.0 - GetParam(), 6.0 - GetParam())), 0.5);
}

// A turn in place, 10 degrees a step: the same against the mean over the headings that are passed, of a head that stands.
TEST_P(PathGlideSteps, ATurnKeepsTheLevelOfEveryBandAtBothEars) {
  const int block = static_cast<int>(std::lround(GetParam() * static_cast<double>(kRateHz)));
  const SoundClip clip = white_noise(2 * 16000, kRateHz, 2);
  constexpr int steps = 20;  // 200 degrees
  const auto heard = stream(binaural_tables(), clip, block, block / 3, steps + 1, [&](int i) {
    return direct_at(3.0, {0, 0, -1}, (10.0 * i - 100.0) * kDegree);
  });
  for (std::size_t ear = 0; ear < 2; ++ear) {
    // Each step beside the mean of five standing heads on its way: closed form enough, as neither combs.
    double worst = 0;
    std::vector<double> moving(third_octave_edges_hz().size() - 1), standing(moving.size());
    for (int step = 1; step <= steps; ++step) {
      const auto part = [&](const std::vector<float>& whole, int index) {
        return std::span(whole).subspan(static_cast<std::size_t>(index * block), static_cast<std::size_t>(block));
      };
      const auto power = band_powers(part(heard[ear], step), kRateHz);
      for (std::size_t b = 0; b < power.size(); ++b) moving[b] += power[b];
      constexpr int heads = 5;
      for (int h = 0; h < heads; ++h) {
        const double weight_position = (h + 0.5) / heads, heading = (10.0 * (step - 1 + weight_position) - 100.0) * kDegree;
        // The window of band_powers counts what is in the middle of the block most.
        const double weight =
            (3.0 - 4.0 * std::cos(2 * std::numbers::pi * weight_position) + std::cos(4 * std::numbers::pi * weight_position)) / 3.0;
        const auto still = stream(binaural_tables(), clip, block, block / 3, step + 1, [&](int) {
          return direct_at(3.0, {0, 0, -1}, heading);
        });
        const auto of_head = band_powers(part(still[ear], step), kRateHz);
        for (std::size_t b = 0; b < of_head.size(); ++b) standing[b] += weight * of_head[b] / heads;
      }
    }
    worst = worst_difference_db(moving, standing);
    EXPECT_LT(worst, 0.5) << "ear " << ear;
  }
}
INSTANTIATE_TEST_SUITE_P(OfATwentiethAndOfThreeTwentieths, PathGlideSteps, testing::Values(0.05, 0.15));

// The Doppler shift of a listener that leaves at 1 m/s: f (1 - v / c).
TEST(PathGlide, ATonesPitchIsThatOfTheMotion) {
  SoundClip clip{.name = "tone", .sample_rate_hz = kRateHz, .samples = std::vector<float>(16000)};
  for (std::size_t n = 0; n < clip.samples.size(); ++n)
    clip.samples[n] = static_cast<float>(std::sin(2.0 * std::numbers::pi * 1000.0 * static_cast<double>(n) / 16000.0));
  const double speed_m_per_s = 5;
  const auto heard = stream(mono_tables(), clip, 800, 266, 20, [&](int i) { return direct_at(100.0 + speed_m_per_s * 0.05 * i); });
  // After the first block, which stands; x(t - r / c) in closed form.
  for (std::size_t n = 900; n < 15900; ++n) {
    const double t = static_cast<double>(n) / 16000.0, r = 100.0 + speed_m_per_s * (t - 0.05);
    const double exact = std::sin(2.0 * std::numbers::pi * 1000.0 * (t - r / static_cast<double>(kSpeed))) / (4.0 * std::numbers::pi * r);
    ASSERT_NEAR(heard[0][n] / exact, 1.0, std::abs(exact) > 2e-4 ? 0.02 : 1e9) << n;
    ASSERT_NEAR(heard[0][n], exact, 2e-6) << n;
  }
}

// At rest the paths sound as their response would.
TEST(PathGlide, AtRestItIsTheConvolutionWithTheResponse) {
  const SoundClip clip = white_noise(9001, kRateHz, 3);
  EnergyResponse response = response_with({arrival_at(3.21, 0.02, {0.6f, 0, -0.8f}), arrival_at(5.77, 0.01, {-1, 0, 0}, 1)});
  for (std::size_t b = 0; b < kMaxBands; ++b) response.arrivals[1].amplitude[b] *= 1.f - 0.1f * static_cast<float>(b % 7);
  for (std::size_t i = 0; i < 2; ++i) response.arrivals[i].identity = i + 1;
  AcousticConfig config = config_at(kRateHz);
  for (const ListenerLayout& layout :
       {ListenerLayout(ChannelLayout::mono), ListenerLayout(ChannelLayout::binaural), ListenerLayout::named("ambisonic:1:sn3d:ego"),
        ListenerLayout::named("surround_5_1"), ListenerLayout::named("stereo:ab")}) {
    std::array<std::vector<std::vector<float>>, 2> sound;
    for (const int glide : {0, 1}) {
      config.glide_paths = 8 * glide;
      const auto tables = make_synthesis_tables(config, BandLayout::octaves(kRateHz), layout, nullptr);
      sound[static_cast<std::size_t>(glide)] = stream(tables, clip, 800, 200, 6, [&](int) { return Heard{response, 0.7}; });
    }
    double difference = 0, power = 0;
    for (std::size_t c = 0; c < sound[0].size(); ++c)
      for (std::size_t n = 0; n < sound[0][c].size(); ++n) {
        difference += std::pow(static_cast<double>(sound[0][c][n] - sound[1][c][n]), 2);
        power += std::pow(static_cast<double>(sound[0][c][n]), 2);
      }
    // White up to half the rate, of which the reader loses the last 1.4 %: half of that, and rounding.
    EXPECT_LT(10.0 * std::log10(difference / power), -18.0) << static_cast<int>(layout.kind);
  }
}

TEST(PathGlide, OfManyPathsTheStrongestGlide) {
  std::vector<Arrival> arrivals;
  for (int i = 0; i < 6; ++i) arrivals.push_back(arrival_at(2.0 + i, i == 4 ? 0.11 : 0.1 / (1 + i), {0, 0, -1}, i));
  const EnergyResponse response = response_with(arrivals);
  PathGlider three(mono_tables(3), 800), many(mono_tables(64), 800), no_glides(mono_tables(0), 800);
  EXPECT_EQ(std::vector<std::uint8_t>(three.choose(response).begin(), three.choose(response).end()),
            (std::vector<std::uint8_t>{1, 1, 0, 0, 1, 0}));
  // -12 dB is a factor of 0.251 in amplitude: 0.0276 of 0.11.
  EXPECT_EQ(std::vector<std::uint8_t>(many.choose(response).begin(), many.choose(response).end()),
            (std::vector<std::uint8_t>{1, 1, 1, 0, 1, 0}));
  for (const std::uint8_t marked : no_glides.choose(response)) EXPECT_EQ(marked, 0);
  EXPECT_TRUE(three.choose(response_with()).empty());
}

// Two paths about one level apart by less than 2 dB, in turn the stronger: the one that glides goes on; 3 dB change it.
TEST(PathGlide, PathsOfAboutOneLevelDoNotTakeTurns) {
  PathGlider glider(mono_tables(1), 800);
  GlidingPaths paths;
  const auto chosen = [&](double first_db, bool remembers) {
    EnergyResponse response = response_with({arrival_at(2, 0.1 * std::pow(10, first_db / 20)), arrival_at(3, 0.1, {1, 0, 0}, 1)});
    response.arrivals[0].identity = 1, response.arrivals[1].identity = 2;
    const auto marked = glider.choose(response, remembers ? &paths : nullptr);
    const int index = marked[0] == 1 ? 0 : 1;
    EXPECT_EQ(marked[0] + marked[1], 1);
    glider.advance(response, marked, 0.0, paths);
    return index;
  };
  for (const bool remembers : {true, false}) {
    paths.forget();
    int changes = 0, before = chosen(0.5, remembers);
    EXPECT_EQ(before, 0);
    for (int i = 0; i < 8; ++i) {
      const int now = chosen(i % 2 == 0 ? -1.5 : 1.5, remembers);
      changes += now != before ? 1 : 0;
      before = now;
    }
    EXPECT_EQ(changes, remembers ? 0 : 8);
    EXPECT_EQ(chosen(-3, remembers), 1);
  }
  // At the edge of the range of 12 dB too: -13 dB goes on, but does not begin.
  PathGlider two(mono_tables(2), 800);
  paths.forget();
  EnergyResponse response = response_with({arrival_at(2, 0.1), arrival_at(3, 0.1 * std::pow(10, -13.0 / 20), {1, 0, 0}, 1)});
  response.arrivals[0].identity = 1, response.arrivals[1].identity = 2;
  EXPECT_EQ(two.choose(response, &paths)[1], 0);
  EnergyResponse louder = response;
  louder.arrivals[1].amplitude.fill(0.05f);
  two.advance(louder, two.choose(louder, &paths), 0.0, paths);
  EXPECT_EQ(two.choose(response, &paths)[1], 1);
}

// No step between blocks, whatever begins, ends, starts to move or jumps: differences from sample to sample of a low tone stay those of a
// tone of that level.
TEST(PathGlide, NothingClicks) {
  SoundClip clip{.name = "tone", .sample_rate_hz = kRateHz, .samples = std::vector<float>(16000)};
  for (std::size_t n = 0; n < clip.samples.size(); ++n)
    clip.samples[n] = static_cast<float>(std::sin(2.0 * std::numbers::pi * 200.0 * static_cast<double>(n) / 16000.0));
  const std::vector<double> distance = {2, 2, 2.1, 2.2, 2.2, 2.05, 2.05, 9, 9, 9.15, 9.3};
  const auto heard = stream(mono_tables(), clip, 800, 266, static_cast<int>(distance.size()), [&](int i) {
    Heard now = direct_at(distance[static_cast<std::size_t>(i)]);
    if (i == 4 || i == 5) now.response.arrivals.clear();
    return now;
  });
  const double most = 1.1 * 2.0 * std::numbers::pi * 200.0 / 16000.0 / (4.0 * std::numbers::pi * 1.95);
  for (std::size_t n = 1; n < heard[0].size(); ++n) ASSERT_LT(std::abs(heard[0][n] - heard[0][n - 1]), most) << n;
}

}  // namespace
}  // namespace earshot
