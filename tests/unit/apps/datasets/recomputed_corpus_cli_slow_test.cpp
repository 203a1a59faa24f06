// SPDX-License-Identifier: Apache-2.0
// The same with ten thousand utterances.

#include "tests/support/programs/recomputed_corpus.h"

namespace earshot {
namespace {

class LargeRecomputedCorpusCli : public RecomputedCorpus {
 protected:
  LargeRecomputedCorpusCli() : RecomputedCorpus("large_recomputed_corpus") {}
};

TEST_F(LargeRecomputedCorpusCli, TenThousandUtterancesAreWhatTheirLabelsSay) {
  constexpr std::size_t kUtterances = 10'000;
  write_speech(kUtterances);
  const Outcome made = convolve("out", "--stems --talkers 1,3 --level -30,-8 --noise " + path("noise"));
  ASSERT_EQ(made.exit_code, 0) << made.text;
  const CorpusDifferences found = compare("out");
  EXPECT_EQ(found.utterances, kUtterances);
  EXPECT_GT(found.longer_talkers, kUtterances / 10);
  EXPECT_GT(found.lowered, 0u);
  expect_none(found);
}

}  // namespace
}  // namespace earshot
