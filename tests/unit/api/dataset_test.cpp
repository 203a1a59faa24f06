// SPDX-License-Identifier: Apache-2.0
// Corpora by the public functions: the files of the engine, and what is refused.
#include "earshot/dataset.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <vector>

#include "datasets/rir_corpus.h"
#include "sim/audio/dry_sounds/sound_clip.h"
#include "tests/support/envs/env_cases.h"
#include "tests/support/envs/rir_corpus_cases.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using testing::HasSubstr;

TEST(ApiDataset, CorporaHaveTheBytesOfTheEngineAndAreCompletedOnce) {
  const RirCorpusConfig config = corpus_cases::tiny();
  const TempFolder folder;
  (void)write_rir_corpus(config, {.out = folder / "engine", .threads = 1, .shard = {}, .progress = {}});
  const auto text = api::Config::from_text(config_text(config));
  std::uint64_t last = 0;
  const api::CorpusReport report = api::write_rir_corpus(
      text, {.out = folder / "api", .threads = 2, .progress = [&](std::uint64_t done, std::uint64_t) { last = done; }});
  EXPECT_EQ(report.written, 18u);
  EXPECT_EQ(report.total, 18u);
  EXPECT_EQ(report.folders_missing, 0u);
  EXPECT_EQ(last, 18u);
  EXPECT_EQ(corpus_cases::differences(corpus_cases::tree(folder / "engine"), corpus_cases::tree(folder / "api")),
            std::vector<std::string>{});
  EXPECT_EQ(api::write_rir_corpus(text, {.out = folder / "api"}).written, 0u);
}

TEST(ApiDataset, WrongInputIsRefused) {
  const TempFolder folder;
  const auto refusal = [&](const std::string& yaml, const std::string& shard = "1/1") {
    return message_of<InputError>(
        [&] { (void)api::write_rir_corpus(api::Config::from_text(yaml), {.out = folder / "out", .shard = shard}); });
  };
  EXPECT_THAT(refusal("shoeboxs: {count: 1}"), HasSubstr("shoebox"));
  EXPECT_THAT(refusal("{shoeboxes: {count: 1}, sofa: true}"), HasSubstr("sofa"));
  EXPECT_THAT(refusal("shoeboxes: {count: 1}", "3/2"), HasSubstr("3/2"));
  EXPECT_FALSE(std::filesystem::exists(folder / "out"));
}

// As `earshot dataset convolve --skip-bad --rt60 --drr`.
TEST(ApiDataset, SignalsSkipBadFilesAndFollowWishedRanges) {
  const TempFolder folder;
  RirCorpusConfig config;
  config.seed = 3;
  config.shoeboxes.count = 60;
  config.shoeboxes.max_size_m = {8, 4, 8};
  config.shoeboxes.absorption = {0.1f, 0.6f};
  config.sources_per_room = 2;
  config.listeners_per_source = 8;
  config.channels = "mono";
  config.acoustics.rays = 64;
  config.acoustics.rir_length_s = 0.6f;
  config.acoustics.sample_rate_hz = 8000;
  (void)write_rir_corpus(config, {.out = folder / "corpus", .threads = 2, .shard = {}, .progress = {}});
  std::filesystem::create_directories(folder / "speech");
  write_wav(folder / "speech/a.wav", std::vector<float>(400, 0.1f), 1, 8000);
  write_text(folder / "speech/b.wav", "no sound");
  const auto signals = [&](api::ConvolveOptions options, const std::string& out) {
    options.corpus = folder / "corpus";
    options.speech = folder / "speech";
    options.count = 300;
    return api::write_convolved_corpus(options, {.out = folder / out, .threads = 2});
  };
  EXPECT_THAT(message_of<InputError>([&] { (void)signals({}, "refused"); }), HasSubstr("b.wav"));
  EXPECT_FALSE(std::filesystem::exists(folder / "refused"));
  EXPECT_EQ(signals({.skip_bad = true}, "plain").left_out, 1u);
  const api::CorpusReport report = signals({.skip_bad = true, .rt60_s = {{0.15f, 0.45f}}, .drr_db = {{-8, 0}}}, "wished");
  EXPECT_EQ(report.total, 300u);
  EXPECT_EQ(report.left_out, 1u);
  std::array<int, 10> tenths{};
  for (const auto& line : corpus_cases::lines_of(folder / "wished/manifest.jsonl")) {
    const double t20_s = line["talkers"][0]["t20_mid_s"], drr_db = line["talkers"][0]["drr_db"];
    EXPECT_TRUE(t20_s >= 0.15 && t20_s <= 0.45 && drr_db >= -8 && drr_db <= 0) << t20_s << " s, " << drr_db << " dB";
    ++tenths[std::min<std::size_t>(9, static_cast<std::size_t>(10 * (t20_s - 0.15) / 0.3))];
  }
  // 30 for each tenth, with a standard deviation of sqrt(300 * 0.1 * 0.9) = 5.2.
  for (const int count : tenths) EXPECT_NEAR(count, 30, 4.5 * 5.2);
  EXPECT_THAT(message_of<InputError>([&] { (void)signals({.skip_bad = true, .rt60_s = {{0.6f, 0.2f}}}, "refused"); }), HasSubstr("--rt60"));
  EXPECT_THAT(message_of<InputError>([&] { (void)signals({.skip_bad = true, .drr_db = {{40, 50}}}, "refused"); }), HasSubstr("--drr"));
}

}  // namespace
}  // namespace earshot
