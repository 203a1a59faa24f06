// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/dry_sounds/sound_clip.h"

#include <gtest/gtest.h>
#include <sndfile.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <numbers>

#include "sim/audio/transforms/fft.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/random.h"
#include "tests/support/files/test_data.h"

namespace earshot {
namespace {

const char* const kKinds[] = {"telephone", "alarm", "music", "noise", "speech", "click", "engine", "bird"};

class SoundClipTest : public ::testing::Test {
 protected:
  SoundClipTest() : folder_(std::filesystem::temp_directory_path() / ("earshot_sound_clip_" + std::to_string(::getpid()))) {
    std::filesystem::create_directories(folder_);
  }
  ~SoundClipTest() override { std::filesystem::remove_all(folder_); }
  [[nodiscard]] std::filesystem::path file(const std::string& name) const { return folder_ / name; }

  /// Writes an interleaved sound in any format of libsndfile.
  std::filesystem::path write(const std::string& name, int format, int rate, int channels, const std::vector<float>& interleaved) const {
    SF_INFO info{};
    info.samplerate = rate;
    info.channels = channels;
    info.format = format;
    SNDFILE* out = sf_open(file(name).c_str(), SFM_WRITE, &info);
    EXPECT_NE(out, nullptr) << name;
    sf_writef_float(out, interleaved.data(), static_cast<sf_count_t>(interleaved.size()) / channels);
    sf_close(out);
    return file(name);
  }

 private:
  std::filesystem::path folder_;
};

std::vector<float> sine(double frequency_hz, double rate_hz, int count) {
  std::vector<float> samples(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i)
    samples[i] = static_cast<float>(0.5 * std::sin(2.0 * std::numbers::pi * frequency_hz * i / rate_hz + 0.3));
  return samples;
}

TEST_F(SoundClipTest, WavRoundTripIsExact) {
  const std::vector<float> channels = {0.f, 0.25f, -1.5f, 3.f, 1e-30f, 7.f};  // two channels of three samples
  write_wav(file("a.wav"), channels, 2, 16000.f);
  const SoundClip clip = load_sound(file("a.wav"), 16000.f);
  EXPECT_EQ(clip.name, "a");
  EXPECT_EQ(clip.sample_rate_hz, 16000.f);
  EXPECT_EQ(clip.samples, (std::vector<float>{1.5f, (0.25f + 1e-30f) / 2.f, 2.75f}));
}

TEST_F(SoundClipTest, SameSoundGivesTheSameBytes) {
  write_wav(file("a.wav"), sine(440, 16000, 1000), 1, 16000.f);
  write_wav(file("b.wav"), sine(440, 16000, 1000), 1, 16000.f);
  const std::string bytes = read_file(file("a.wav"));
  EXPECT_EQ(bytes, read_file(file("b.wav")));
  EXPECT_EQ(bytes.substr(0, 4), "RIFF");
  EXPECT_EQ(bytes.find("PEAK"), std::string::npos);  // libsndfile's own chunk with the time of day
}

// WAVEFORMATEXTENSIBLE: tag 0xFFFE at byte 20, the mask at byte 40.
TEST_F(SoundClipTest, ChannelMasksStandInTheHeader) {
  std::vector<float> channels(8 * 50);
  for (std::size_t i = 0; i < channels.size(); ++i) channels[i] = static_cast<float>(i) - 200.5f;
  const auto number = [](const std::string& bytes, std::size_t at, std::size_t size) {
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < size; ++i) value |= std::uint32_t{static_cast<std::uint8_t>(bytes[at + i])} << (8 * i);
    return value;
  };
  struct Case {
    int channels;
    std::uint32_t mask;
  };
  for (const auto& [count, mask] : {Case{4, 0x33}, Case{6, 0x60F}, Case{8, 0x63F}, Case{1, 0x4}, Case{2, 0x20001}}) {
    const auto part = std::span(channels).first(static_cast<std::size_t>(count) * 50);
    write_wav(file("m.wav"), part, count, 16000.f, mask);
    const std::string bytes = read_file(file("m.wav"));
    EXPECT_EQ(number(bytes, 20, 2), 0xFFFEu) << mask;
    EXPECT_EQ(number(bytes, 22, 2), static_cast<std::uint32_t>(count));
    EXPECT_EQ(number(bytes, 40, 4), mask);
    EXPECT_EQ(bytes.find("PEAK"), std::string::npos);
    const SoundChannels back = load_sound_channels(file("m.wav"));
    EXPECT_EQ(back.num_channels, count);
    EXPECT_TRUE(std::ranges::equal(back.samples, part));
  }
  write_wav(file("p.wav"), channels, 8, 16000.f);
  EXPECT_EQ(number(read_file(file("p.wav")), 20, 2), 3u);  // IEEE float, plain
  for (const std::uint32_t wrong : {0x3u, 0x7FFu, 0xFF000000u})
    EXPECT_THROW(write_wav(file("p.wav"), channels, 8, 16000.f, wrong), InputError) << wrong;
}

TEST_F(SoundClipTest, ReadsPcmFlacAndOgg) {
  const auto wave = sine(440, 16000, 16000);
  EXPECT_NEAR(load_sound(write("p.wav", SF_FORMAT_WAV | SF_FORMAT_PCM_16, 16000, 1, wave), 16000.f).samples[777], wave[777], 1.0 / 32768);
  EXPECT_NEAR(load_sound(write("f.flac", SF_FORMAT_FLAC | SF_FORMAT_PCM_24, 16000, 1, wave), 16000.f).samples[777], wave[777], 1e-6);
  const SoundClip vorbis = load_sound(write("o.ogg", SF_FORMAT_OGG | SF_FORMAT_VORBIS, 16000, 1, wave), 16000.f);
  EXPECT_EQ(vorbis.samples.size(), 16000u);
  EXPECT_NEAR(vorbis.samples[777], wave[777], 0.05);  // a lossy codec
}

TEST_F(SoundClipTest, ResamplingKeepsTimeAndShape) {
  // The same tone at the other rate, phase included: a delay of half a sample would be an error of 0.04.
  for (const auto& [from, to] : {std::pair{44100, 16000}, {48000, 16000}, {16000, 44100}, {22050, 8000}, {8000, 96000}, {11025, 48000}}) {
    const auto path = write("r.wav", SF_FORMAT_WAV | SF_FORMAT_FLOAT, from, 1, sine(1000, from, from));
    const SoundClip clip = load_sound(path, static_cast<float>(to));
    ASSERT_EQ(clip.samples.size(), static_cast<std::size_t>(to)) << from << " to " << to;
    const auto expected = sine(1000, to, to);
    for (int i = to / 50; i < to - to / 50; ++i) ASSERT_NEAR(clip.samples[i], expected[i], 1e-3) << from << " to " << to << " at " << i;
  }
}

TEST_F(SoundClipTest, ResamplingRemovesWhatWouldAlias) {
  const auto path = write("r.wav", SF_FORMAT_WAV | SF_FORMAT_FLOAT, 48000, 1, sine(9000, 48000, 48000));
  double energy = 0;
  const SoundClip clip = load_sound(path, 16000.f);
  for (std::size_t i = 400; i + 400 < clip.samples.size(); ++i) energy += static_cast<double>(clip.samples[i]) * clip.samples[i];
  EXPECT_LT(energy / 15200, 1e-6 * 0.125);  // 60 dB below the tone
}

TEST_F(SoundClipTest, RefusesBadFiles) {
  const auto expect_refused = [&](const std::filesystem::path& path, const std::string& text) {
    try {
      load_sound(path, 16000.f);
      ADD_FAILURE() << path << " was accepted";
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(text), std::string::npos) << error.what();
      EXPECT_NE(std::string(error.what()).find(path.filename().string()), std::string::npos) << error.what();
    }
  };
  expect_refused(file("missing.wav"), "no such file");
  expect_refused(file(""), "is not a file");
  std::ofstream(file("text.wav")) << "hello, this is not a sound at all";
  expect_refused(file("text.wav"), "cannot be read as sound");
  std::ofstream(file("zero.wav"));
  expect_refused(file("zero.wav"), "cannot be read as sound");
  expect_refused(write("none.wav", SF_FORMAT_WAV | SF_FORMAT_FLOAT, 16000, 1, {}), "no samples");
  expect_refused(write("nan.wav", SF_FORMAT_WAV | SF_FORMAT_FLOAT, 16000, 1, {0.f, std::numeric_limits<float>::quiet_NaN()}), "sample 1");
  expect_refused(write("inf.wav", SF_FORMAT_WAV | SF_FORMAT_FLOAT, 16000, 2, {0.f, std::numeric_limits<float>::infinity()}), "sample 0");
  expect_refused(write("slow.wav", SF_FORMAT_WAV | SF_FORMAT_FLOAT, 999, 1, {0.f, 1.f}), "999 Hz");
  expect_refused(write("long.wav", SF_FORMAT_WAV | SF_FORMAT_PCM_U8, 1000, 1, std::vector<float>(600001)), "10 minutes");
  const auto fine = write("fine.wav", SF_FORMAT_WAV | SF_FORMAT_FLOAT, 16000, 1, {0.f, 1.f});
  for (const float rate : {0.f, 999.f, 16000.5f, 1e6f, std::numeric_limits<float>::quiet_NaN()})
    EXPECT_THROW(load_sound(fine, rate), InputError) << rate;
  EXPECT_THROW(write_wav(file("w.wav"), std::vector<float>(3), 2, 16000.f), InputError);
  EXPECT_THROW(write_wav(file("w.wav"), std::vector<float>{std::numeric_limits<float>::infinity()}, 1, 16000.f), RunError);
  EXPECT_FALSE(std::filesystem::exists(file("w.wav")));
}

// Damaged files must end in an InputError or in a sound, never in a crash, a hang or non-finite samples.
TEST_F(SoundClipTest, SurvivesDamagedFiles) {
  const auto wave = sine(440, 16000, 600);
  write("a.wav", SF_FORMAT_WAV | SF_FORMAT_PCM_16, 16000, 2, wave);
  write("a.flac", SF_FORMAT_FLAC | SF_FORMAT_PCM_16, 16000, 2, wave);
  write("a.ogg", SF_FORMAT_OGG | SF_FORMAT_VORBIS, 16000, 1, wave);
  const auto try_bytes = [&](const std::string& bytes) {
    std::ofstream(file("damaged"), std::ios::binary) << bytes;
    try {
      for (const float value : load_sound(file("damaged"), 8000.f).samples) ASSERT_TRUE(std::isfinite(value));
    } catch (const InputError&) {
    }
  };
  const RandomStream random(1, Purpose::test);
  std::uint32_t draw = 0;
  for (const char* name : {"a.wav", "a.flac", "a.ogg"}) {
    const std::string whole = read_file(file(name));
    for (std::size_t cut = 0; cut < whole.size(); cut += 1 + whole.size() / 30) try_bytes(whole.substr(0, cut));
    for (int trial = 0; trial < 60; ++trial) {
      std::string flipped = whole;
      const auto span = static_cast<std::uint32_t>(trial % 2 == 0 ? std::min<std::size_t>(64, whole.size()) : whole.size());
      for (int i = 0; i < 3; ++i, draw += 2) flipped[random.below(span, draw)] ^= static_cast<char>(1 << random.below(8, draw + 1));
      try_bytes(flipped);
    }
  }
}

TEST_F(SoundClipTest, ReadsTheRealSounds) {
  SKIP_WITHOUT_DATA("audio");
  int count = 0;
  for (const auto& entry : std::filesystem::directory_iterator(data_folder() / "audio")) {
    const SoundClip clip = load_sound(entry.path(), 16000.f);
    double energy = 0;
    for (const float value : clip.samples) energy += static_cast<double>(value) * value;
    EXPECT_GT(energy, 0) << entry.path();
    ++count;
  }
  EXPECT_GT(count, 3);
}

/// Energy per octave (125 Hz ... 4 kHz), dB relative to the loudest.
std::vector<double> octave_levels_db(const SoundClip& clip) {
  RealFft fft(next_power_of_two(static_cast<int>(clip.samples.size())));
  std::vector<std::complex<float>> spectrum(fft.num_bins());
  fft.forward(clip.samples, spectrum);
  std::vector<double> levels(6, 0.0);
  for (int k = 0; k < fft.num_bins(); ++k) {
    const double octave = std::floor(std::log2(std::max(1e-3, k * static_cast<double>(clip.sample_rate_hz) / fft.size() / 88.4)));
    if (octave >= 0 && octave < 6) levels[static_cast<std::size_t>(octave)] += std::norm(spectrum[k]);
  }
  const double loudest = *std::max_element(levels.begin(), levels.end());
  for (double& level : levels) level = 10.0 * std::log10(level / loudest + 1e-12);
  return levels;
}

TEST(SyntheticSound, KeepsItsPromises) {
  for (const char* kind : kKinds) {
    for (const int seed : {0, 1}) {
      for (const float rate : {8000.f, 16000.f, 44100.f}) {
        const std::string spec = std::string("synth:") + kind + ":" + std::to_string(seed);
        const SoundClip clip = open_sound(spec, rate);
        EXPECT_EQ(clip.name, spec);
        EXPECT_GE(static_cast<float>(clip.samples.size()), 0.99f * rate);
        EXPECT_LE(static_cast<float>(clip.samples.size()), 3.01f * rate);
        float peak = 0, step = 0, bend = 0;
        const std::size_t n = clip.samples.size();
        const auto at = [&](std::size_t i) { return clip.samples[i % n]; };
        for (std::size_t i = 0; i < n; ++i) {
          ASSERT_TRUE(std::isfinite(at(i)));
          peak = std::max(peak, std::abs(at(i)));
          if (i + 2 >= n) continue;
          step = std::max(step, std::abs(at(i + 1) - at(i)));
          bend = std::max(bend, std::abs(at(i + 2) - 2 * at(i + 1) + at(i)));
        }
        EXPECT_FLOAT_EQ(peak, 0.5f) << spec;
        // The seam is no sharper than the sharpest place inside.
        EXPECT_LE(std::abs(at(n) - at(n - 1)), step) << spec;
        EXPECT_LE(std::abs(at(n) - 2 * at(n - 1) + at(n - 2)), bend) << spec;
        EXPECT_LE(std::abs(at(n + 1) - 2 * at(n) + at(n - 1)), bend) << spec;
      }
    }
  }
}

// Ears need both: below 1.5 kHz the time difference, above it the level difference.
TEST(SyntheticSound, IsBroadEnoughToLocalize) {
  for (const char* kind : kKinds) {
    for (const int seed : {0, 1, 2, 3}) {
      const auto levels = octave_levels_db(synthesize_sound(std::string("synth:") + kind + ":" + std::to_string(seed), 16000.f));
      EXPECT_GT(*std::max_element(levels.begin(), levels.begin() + 4), -35) << kind << seed;  // octaves 125 Hz to 1 kHz
      EXPECT_GT(*std::max_element(levels.begin() + 4, levels.end()), -35) << kind << seed;    // 2 and 4 kHz
    }
  }
}

TEST(SyntheticSound, KindsAndSeedsDiffer) {
  std::vector<std::vector<float>> all;
  for (const char* kind : kKinds)
    for (const int seed : {0, 1, 18})
      all.push_back(synthesize_sound(std::string("synth:") + kind + ":" + std::to_string(seed), 16000.f).samples);
  for (std::size_t a = 0; a < all.size(); ++a) {
    for (std::size_t b = 0; b < a; ++b) {
      const std::size_t n = std::min(all[a].size(), all[b].size());
      double ab = 0, aa = 0, bb = 0;
      for (std::size_t i = 0; i < n; ++i) {
        ab += static_cast<double>(all[a][i]) * all[b][i];
        aa += static_cast<double>(all[a][i]) * all[a][i];
        bb += static_cast<double>(all[b][i]) * all[b][i];
      }
      EXPECT_LT(std::abs(ab) / std::sqrt(aa * bb), 0.5) << a << ' ' << b;
    }
  }
}

TEST(SyntheticSound, SameSpecGivesTheSameBits) {
  for (const char* kind : kKinds) {
    const std::string spec = std::string("synth:") + kind;
    EXPECT_EQ(synthesize_sound(spec, 16000.f).samples, synthesize_sound(spec, 16000.f).samples);
    EXPECT_EQ(synthesize_sound(spec, 16000.f).samples, synthesize_sound(spec + ":0", 16000.f).samples);  // seed 0 is the default
  }
}

TEST(SyntheticSound, RefusesOtherSpecs) {
  for (const char* spec :
       {"synth:", "synth:dog", "synth:bird:", "synth:bird:x", "synth:bird:-1", "synth:bird:1:2", "synth:bird:99999999999999999999", "bird"})
    EXPECT_THROW(synthesize_sound(spec, 16000.f), InputError) << spec;
  EXPECT_THROW(synthesize_sound("synth:bird", 10.f), InputError);
  EXPECT_NO_THROW(synthesize_sound("synth:bird:18446744073709551615", 16000.f));
}

}  // namespace
}  // namespace earshot
