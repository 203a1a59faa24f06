// SPDX-License-Identifier: Apache-2.0
// Reverberant signals: what is mixed, at what level, and what the labels say.

#include "datasets/convolve_corpus.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <numbers>
#include <set>
#include <string>
#include <vector>

#include "datasets/corpus_sounds.h"
#include "datasets/inputs/transcripts.h"
#include "datasets/response_index.h"
#include "sim/base/errors.h"
#include "tests/support/envs/convolve_corpus_cases.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using corpus_cases::ConvolveFiles;
using corpus_cases::lines_of;
using corpus_cases::read_float_wav;
using testing::HasSubstr;
using Sound = std::vector<std::vector<float>>;

class ConvolveCorpus : public testing::Test {
 protected:
  void run(const ConvolveConfig& config, const std::string& out = "out") const {
    const ConvolveReport report = write_convolve_corpus(config, {.out = files_.path(out), .threads = 2, .shard = {}, .progress = {}});
    EXPECT_EQ(report.folders_missing, 0u);
    EXPECT_EQ(report.signals, report.all_signals);
  }
  [[nodiscard]] Sound sound(const std::string& file, const std::string& out = "out") const {
    return read_float_wav(read_file(files_.path(out) / file)).channels;
  }
  [[nodiscard]] std::map<std::string, nlohmann::json> responses() const {
    std::map<std::string, nlohmann::json> all;
    for (const auto& line : lines_of(files_.path("corpus/manifest.jsonl"))) all[line["id"]] = line;
    return all;
  }
  static double energy(const Sound& channels) {
    double sum = 0;
    for (const auto& channel : channels)
      for (const float sample : channel) sum += static_cast<double>(sample) * static_cast<double>(sample);
    return sum;
  }
  ConvolveFiles files_{"convolve_corpus"};
};

/// Sample n of a sound after a fractional delay, by the band-limited kernel of 512 samples: the inverse transform of
/// exp(-2 pi i k delay / 512), in closed form.  Of the kernel nothing sounds before the source does.
double delayed_sample(const std::vector<float>& dry, double delay, std::size_t n) {
  constexpr int kSize = 512;
  const double whole = std::round(delay);
  double sum = 0;
  for (int k = -kSize / 2; k < kSize / 2; ++k) {
    const double at = whole + k, apart = at - delay, sample = static_cast<double>(n) - at;
    if (at < 0 || sample < 0 || sample >= static_cast<double>(dry.size())) continue;
    const double kernel = std::sin(std::numbers::pi * apart) / (kSize * std::tan(std::numbers::pi * apart / kSize));
    sum += static_cast<double>(dry[static_cast<std::size_t>(sample)]) * kernel;
  }
  return sum;
}

// By the sum that defines it, from the files that the labels name.
TEST_F(ConvolveCorpus, SignalsAreSpeechThroughTheResponseOfTheLabel) {
  ConvolveConfig config = files_.config();
  config.count = 6;
  config.early = config.dry = true;
  run(config);
  const auto corpus = responses();
  std::set<std::string> speech;
  for (const auto& line : lines_of(files_.path("out/manifest.jsonl"))) {
    ASSERT_EQ(line["talkers"].size(), 1u);
    const auto& talker = line["talkers"][0];
    speech.insert(talker["speech"]);
    const auto& response = corpus.at(talker["response"]);
    const SoundClip dry = load_sound(files_.path("speech") / talker["speech"].get<std::string>(), 16000);
    EXPECT_EQ(talker["num_samples"], dry.samples.size());
    const double gain = talker["gain"].get<double>();
    for (const auto& [file, filter_file] : {std::pair{line["file"], response["file"]}, {talker["early_file"], response["early_file"]}}) {
      const Sound wet = sound(file);
      const Sound filter = read_float_wav(read_file(files_.path("corpus") / filter_file.get<std::string>())).channels;
      ASSERT_EQ(wet.size(), 2u);
      ASSERT_EQ(wet[0].size(), dry.samples.size() + filter[0].size() - 1);
      for (std::size_t channel = 0; channel < 2; ++channel)
        for (std::size_t n = 0; n < wet[channel].size(); n += 97) {
          double sum = 0;
          for (std::size_t k = 0; k < filter[channel].size(); ++k)
            if (n >= k && n - k < dry.samples.size())
              sum += static_cast<double>(dry.samples[n - k]) * static_cast<double>(filter[channel][k]);
          ASSERT_NEAR(wet[channel][n], gain * sum, 1e-5) << line;  // peaks are near 0.1; six digits of the gain, float transforms
        }
    }
    const Sound aligned = sound(talker["dry_file"]);
    ASSERT_EQ(aligned.size(), 1u);
    const double delay = 16000 * response["direct_delay_s"].get<double>();
    const double level = gain / (4 * std::numbers::pi * response["distance_m"].get<double>());
    for (std::size_t n = 0; n < aligned[0].size(); n += 97)
      ASSERT_NEAR(aligned[0][n], level * delayed_sample(dry.samples, delay, n), 1e-5) << line;
    for (const char* key : {"azimuth_deg", "elevation_deg", "distance_m", "drr_db", "line_of_sight"}) EXPECT_EQ(talker[key], response[key]);
  }
  EXPECT_EQ(speech.size(), 3u);  // each in turn
}

TEST_F(ConvolveCorpus, TalkersAndNoiseAddUpAtTheRatiosOfTheLabels) {
  ConvolveConfig config = files_.config();
  config.min_talkers = 2;
  config.max_talkers = 2;
  config.stems = true;
  const std::vector<std::string> noises_of{"", "synth", "synth:click", files_.path("noise").string()};
  for (const std::string& noise : noises_of) {
    config.noise = noise;
    config.count = 8;
    const std::string out = "noise_" + std::to_string(noise.size());
    run(config, out);
    double lowest = 1000, highest = -1000;
    for (const auto& line : lines_of(files_.path(out) / "manifest.jsonl")) {
      const Sound whole = sound(line["file"], out);
      ASSERT_EQ(line["talkers"].size(), 2u);
      const Sound first = sound(line["talkers"][0]["file"], out), second = sound(line["talkers"][1]["file"], out);
      EXPECT_NE(line["talkers"][0]["source"], line["talkers"][1]["source"]);
      EXPECT_EQ(line["talkers"][0]["room"], line["talkers"][1]["room"]);
      EXPECT_NE(line["talkers"][0]["speech"], line["talkers"][1]["speech"]);
      EXPECT_TRUE(line["talkers"][1]["same_listener"].get<bool>());
      const double ratio_db = 10 * std::log10(energy(second) / energy(first));
      EXPECT_TRUE(ratio_db > -5.02 && ratio_db < 5.02) << ratio_db;
      Sound talkers = first;
      for (std::size_t c = 0; c < 2; ++c)
        for (std::size_t n = 0; n < talkers[c].size(); ++n) talkers[c][n] += second[c][n];
      Sound sum = talkers;
      if (!noise.empty()) {
        const Sound noises = sound(line["noise"]["file"], out);
        for (std::size_t c = 0; c < 2; ++c)
          for (std::size_t n = 0; n < sum[c].size(); ++n) sum[c][n] += noises[c][n];
        const double snr_db = line["noise"]["snr_db"].get<double>();
        EXPECT_NEAR(10 * std::log10(energy(talkers) / energy(noises)), snr_db, 0.01);
        lowest = std::min(lowest, snr_db), highest = std::max(highest, snr_db);
        // Both sources of the room are taken by talkers: noise of each channel's own.
        EXPECT_TRUE(line["noise"]["response"].is_null());
      } else {
        EXPECT_TRUE(line["noise"].is_null());
      }
      for (std::size_t c = 0; c < 2; ++c)
        for (std::size_t n = 0; n < sum[c].size(); ++n) ASSERT_NEAR(whole[c][n], sum[c][n], 1e-6);
      EXPECT_NEAR(10 * std::log10(energy(whole) / (2.0 * static_cast<double>(whole[0].size()))), line["level_dbfs"].get<double>(), 0.01);
    }
    EXPECT_TRUE(noise.empty() || (lowest >= 5 && highest <= 25 && highest - lowest > 5)) << lowest << " " << highest;
  }
}

TEST_F(ConvolveCorpus, NoiseComesFromASourceThatIsLeft) {
  ConvolveConfig config = files_.config();
  config.noise = files_.path("noise").string();
  config.stems = true;
  config.count = 6;
  run(config);
  const auto corpus = responses();
  for (const auto& line : lines_of(files_.path("out/manifest.jsonl"))) {
    const auto &talker = corpus.at(line["talkers"][0]["response"]), &noise = corpus.at(line["noise"]["response"]);
    EXPECT_EQ(noise["room"], talker["room"]);
    EXPECT_NE(noise["source"]["index"], talker["source"]["index"]);
    EXPECT_EQ(noise["listener"]["position_m"], talker["listener"]["position_m"]);
    EXPECT_TRUE(line["noise"]["same_listener"].get<bool>());
    // In the middle: what has been sounding since before the first sample, through the response.
    const SoundClip clip = load_sound(files_.path("noise/engine.wav"), 16000);
    const auto filter = read_float_wav(read_file(files_.path("corpus") / noise["file"].get<std::string>())).channels;
    const Sound heard = sound(line["noise"]["file"]);
    const auto start = line["noise"]["start_sample"].get<std::size_t>();
    for (const std::size_t n : {std::size_t{0}, std::size_t{1}, std::size_t{777}}) {
      double sum = 0;
      for (std::size_t k = 0; k < filter[0].size(); ++k)
        sum += static_cast<double>(clip.samples[(start + filter[0].size() - 1 + n - k) % clip.samples.size()]) *
               static_cast<double>(filter[0][k]);
      EXPECT_NEAR(heard[0][n], line["noise"]["gain"].get<double>() * sum, 1e-5);
    }
  }
}

// Loud enough that peaks would pass full scale: all of a signal is lowered by one factor, and its label says so.
TEST_F(ConvolveCorpus, NothingClips) {
  ConvolveConfig config = files_.config();
  config.level_dbfs = {-3, 0};
  config.dry = config.stems = true;
  config.format = SoundFormat::flac;
  config.count = 6;
  run(config);
  std::size_t lowered = 0;
  for (const auto& line : lines_of(files_.path("out/manifest.jsonl"))) {
    float peak = 0;
    for (const std::string file : {line["file"], line["talkers"][0]["file"], line["talkers"][0]["dry_file"]}) {
      const SoundChannels heard = load_sound_channels(files_.path("out") / file);
      for (const float sample : heard.samples) peak = std::max(peak, std::abs(sample));
    }
    EXPECT_LT(peak, 0.9991f);
    lowered += line["lowered"].get<bool>();
    EXPECT_TRUE(!line["lowered"].get<bool>() || peak > 0.998f) << peak;
  }
  EXPECT_EQ(lowered, 6u);  // the crest factor of speech is far above 3 dB
}

TEST_F(ConvolveCorpus, SupervisionsCoverTheSpeech) {
  ConvolveConfig config = files_.config();
  config.count = 3;
  config.cut = true;
  config.noise = "synth";
  run(config);
  const auto recordings = lines_of(files_.path("out/recordings.jsonl")), lines = lines_of(files_.path("out/manifest.jsonl"));
  const auto segments = lines_of(files_.path("out/supervisions.jsonl"));
  ASSERT_EQ(segments.size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(segments[i]["recording_id"], recordings[i]["id"]);
    EXPECT_EQ(segments[i]["channel"], nlohmann::json({0, 1}));
    EXPECT_NEAR(segments[i]["start"].get<double>(), lines[i]["talkers"][0]["direct_delay_s"].get<double>(), 0.5 / 16000 + 1e-9);
    EXPECT_LE(segments[i]["start"].get<double>() + segments[i]["duration"].get<double>(), recordings[i]["duration"].get<double>() + 1e-9);
    // Cut: no tail, and the direct sound to its end.
    const auto samples = lines[i]["talkers"][0]["num_samples"].get<std::size_t>();
    EXPECT_EQ(recordings[i]["num_samples"], samples + std::lround(16000 * lines[i]["talkers"][0]["direct_delay_s"].get<double>()));
    EXPECT_NEAR(segments[i]["duration"].get<double>(), static_cast<double>(samples) / 16000, 1e-12);
    EXPECT_EQ(segments[i]["custom"]["snr_db"], lines[i]["noise"]["snr_db"]);
    EXPECT_EQ(segments[i].contains("text"), lines[i]["talkers"][0]["speech"] == "b.wav");
  }
  EXPECT_EQ(segments[1]["text"], "words of b");
}

TEST_F(ConvolveCorpus, WhatCannotBeIsOneLine) {
  const auto refused = [&](const auto& change) {
    ConvolveConfig config = files_.config();
    change(config);
    return message_of<InputError>([&] { run(config, "refused"); });
  };
  EXPECT_THAT(refused([&](auto& c) { c.corpus = files_.path("speech").string(); }), HasSubstr("contains no corpus.json"));
  EXPECT_THAT(refused([&](auto& c) { c.speech = files_.path("none").string(); }), HasSubstr("is not a folder"));
  EXPECT_THAT(refused([&](auto& c) { c.noise = "synth:nose"; }), HasSubstr("nose"));
  EXPECT_THAT(refused([&](auto& c) { c.max_talkers = 3; }), HasSubstr("more than the 2 sources in a room"));
  EXPECT_THAT(refused([&](auto& c) { c.snr_db = {20, 5}; }), HasSubstr("--snr"));
  EXPECT_THAT(refused([&](auto& c) { c.signals_per_folder = 15; }), HasSubstr("--signals-per-folder = 15"));
  EXPECT_FALSE(std::filesystem::exists(files_.path("refused")));
  write_wav(files_.path("speech/silent.wav"), std::vector<float>(2000, 0.f), 1, 16000);
  EXPECT_THAT(refused([](auto&) {}), HasSubstr("silent.wav: is silent"));
  std::filesystem::remove(files_.path("corpus/manifest.jsonl"));
  EXPECT_THAT(refused([](auto&) {}), HasSubstr("an incomplete corpus"));
}

// What a manifest cannot hold is named before anything is written.
TEST_F(ConvolveCorpus, TextThatIsNotUtf8IsRefused) {
  const auto refused = [&] { return message_of<InputError>([&] { run(files_.config(), "refused"); }); };
  write_text(files_.path("speech/other/c.txt"), "caf\xE9");
  EXPECT_THAT(refused(), HasSubstr("c.txt: is not UTF-8 text"));
  write_text(files_.path("speech/other/c.txt"), "caf\xC3\xA9");
  std::filesystem::copy_file(files_.path("speech/a.wav"), files_.path("speech/caf\xE9.wav"));
  EXPECT_THAT(refused(), HasSubstr("has a name that is not valid UTF-8"));
  EXPECT_FALSE(std::filesystem::exists(files_.path("refused")));
}

TEST_F(ConvolveCorpus, LinksAreFollowedButNotInCircles) {
  ConvolveConfig config = files_.config();
  config.count = 0;
  std::filesystem::create_directory_symlink(files_.path("noise"), files_.path("speech/linked"));
  std::filesystem::create_symlink(files_.path("nowhere.wav"), files_.path("speech/gone.wav"));
  EXPECT_EQ(SoundFolder::list(config.speech).files,
            (std::vector<std::string>{"a.wav", "b.wav", "gone.wav", "linked/engine.wav", "other/c.wav"}));
  std::filesystem::create_directory_symlink(files_.path("speech"), files_.path("speech/other/back"));
  EXPECT_THAT(message_of<InputError>([&] { SoundFolder::list(config.speech); }), HasSubstr("look for a symbolic link that leads back"));
}

TEST_F(ConvolveCorpus, FoldersOfTextsThatCannotBeListedAreNamed) {
  const SoundFolder gone{.root = files_.path("gone"), .files = {"a.wav"}};
  EXPECT_THAT(message_of<InputError>([&] { Transcripts{gone}; }), HasSubstr("gone: cannot be listed: "));
}

TEST_F(ConvolveCorpus, OtherWordsAreAnotherCorpus) {
  ConvolveConfig config = files_.config();
  config.count = 3;
  run(config);
  write_text(files_.path("speech/b.txt"), "words of d\n");  // of the same length
  EXPECT_THAT(message_of<InputError>([&] { run(config); }), HasSubstr("started with other settings: 'transcripts_hash"));
}

TEST_F(ConvolveCorpus, NumbersOfADamagedManifestAreRefused) {
  const std::string manifest = read_file(files_.path("corpus/manifest.jsonl")), description = read_file(files_.path("corpus/corpus.json"));
  const auto refused = [&](const std::string& file, const std::string& text, const std::string& key, const std::string& value) {
    const std::size_t at = text.find("\"" + key + "\":") + key.size() + 3;
    write_text(files_.path(file), text.substr(0, at) + value + text.substr(text.find_first_of(",\n", at)));
    return message_of<InputError>([&] { ResponseIndex(files_.path("corpus")); });
  };
  for (const char* key : {"direct_delay_s", "distance_m"})
    EXPECT_THAT(refused("corpus/manifest.jsonl", manifest, key, "1e300"),
                HasSubstr("manifest.jsonl:1: has a number outside the valid range"));
  write_text(files_.path("corpus/manifest.jsonl"), manifest);
  EXPECT_EQ(ResponseIndex(files_.path("corpus")).sample_rate_hz(), 16000);
  // A recursive reader calls itself once per bracket.
  const std::string deep = R"({"a":)" + std::string(100'000, '[') + std::string(100'000, ']') + "}";
  for (const char* key : {"listener", "scene"})
    EXPECT_THAT(refused("corpus/manifest.jsonl", manifest, key, deep),
                HasSubstr("manifest.jsonl:1: is not a valid line of a response manifest"))
        << key;
  write_text(files_.path("corpus/manifest.jsonl"), manifest);
  EXPECT_THAT(refused("corpus/corpus.json", description, "sample_rate_hz", "1e30"), HasSubstr("has a sample rate outside the valid range"));
  EXPECT_THAT(refused("corpus/corpus.json", description, "sample_rate_hz", deep), HasSubstr("is not a valid line of a response manifest"));
}

}  // namespace
}  // namespace earshot
