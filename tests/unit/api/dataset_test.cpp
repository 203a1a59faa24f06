// SPDX-License-Identifier: Apache-2.0
// Corpora by the public functions: the files of the engine, and what is refused.
#include "earshot/dataset.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "datasets/rir_corpus.h"
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

}  // namespace
}  // namespace earshot
