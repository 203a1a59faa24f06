// SPDX-License-Identifier: Apache-2.0
// Texts, lengths, levels, ratios and times of a corpus of signals, recomputed from its sounds.

#include "tests/support/programs/recomputed_corpus.h"

namespace earshot {
namespace {

class RecomputedCorpusCli : public RecomputedCorpus {
 protected:
  RecomputedCorpusCli() : RecomputedCorpus("recomputed_corpus") {}
};

TEST_F(RecomputedCorpusCli, TwoHundredUtterancesAreWhatTheirLabelsSay) {
  constexpr std::size_t kUtterances = 200;
  write_speech(kUtterances);
  const Outcome made = convolve("out", "--stems --talkers 1,3 --level -30,-8 --noise " + path("noise"));
  ASSERT_EQ(made.exit_code, 0) << made.text;
  const CorpusDifferences found = compare("out");
  EXPECT_EQ(found.utterances, kUtterances);
  EXPECT_GT(found.talkers, kUtterances + kUtterances / 2);
  EXPECT_GT(found.later_talkers, kUtterances / 10);
  EXPECT_GT(found.longer_talkers, kUtterances / 10);
  expect_none(found);
}

// The comparison sees a text, a sample and a level that are off.
TEST_F(RecomputedCorpusCli, TheComparisonSeesWhatIsOff) {
  write_speech(20);
  ASSERT_EQ(convolve("out", "--stems --noise " + path("noise")).exit_code, 0);
  const auto manifest = read_file(path("out/manifest.jsonl"));
  const auto change = [&](const std::string& key, const std::string& value) {
    const std::size_t at = manifest.find("\"" + key + "\":") + key.size() + 3;
    write_text(path("out/manifest.jsonl"), manifest.substr(0, at) + value + manifest.substr(manifest.find_first_of(",}", at)));
    return compare("out");
  };
  EXPECT_EQ(change("start_sample", "1").times, 2u);
  // By 0.002 dB, twice what the comparison allows.
  const auto apart = [&](const std::string& key) {
    return fmt::format("{:.6f}", lines("out/manifest.jsonl").at(0).at(key).get<double>() + 0.002);
  };
  write_text(path("out/manifest.jsonl"), manifest);
  EXPECT_EQ(change("level_dbfs", apart("level_dbfs")).levels, 1u);
  write_text(path("out/manifest.jsonl"), manifest);
  const double snr_db = lines("out/manifest.jsonl").at(0).at("noise").at("snr_db").get<double>();
  EXPECT_EQ(change("snr_db", fmt::format("{:.6f}", snr_db + 0.002)).ratios, 1u);
  EXPECT_EQ(change("text", "\"WORDS\"").texts, 1u);
  EXPECT_GE(change("num_samples", "3").lengths, 1u);
  EXPECT_EQ(change("gain", "0.001").times, 1u);
}

}  // namespace
}  // namespace earshot
