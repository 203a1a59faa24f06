// SPDX-License-Identifier: Apache-2.0
// Random configs read by our reader and by yaml-cpp: the same structure and texts before types are resolved, or ours refuses in one line.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/yaml_parser.h"
#include "tests/support/configs/random_config.h"
#include "tests/support/configs/yaml_cpp_tree.h"
#include "tests/support/files/test_paths.h"

namespace earshot {
namespace {

struct Tally {
  int accepted = 0, refused = 0, refused_alone = 0;
};

void compare(const std::string& text, Tally& tally, const std::string& label) {
  const std::optional<YamlNode> theirs = YamlCppTree::of(text);
  YamlNode ours;
  try {
    ours = parse_yaml(text, {.where = "fuzz.yaml"});
  } catch (const InputError& error) {
    const std::string message = error.what();
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
    EXPECT_TRUE(message.starts_with("fuzz.yaml:")) << message;
    ++tally.refused;
    if (theirs) ++tally.refused_alone;
    return;
  }
  ++tally.accepted;
  ASSERT_TRUE(theirs) << label << ": yaml-cpp refuses\n" << text;
  ASSERT_EQ(difference(ours, *theirs), "") << label << "\n" << text;
}

std::vector<std::string> shipped_configs() {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(source_dir() / "configs"))
    if (entry.path().extension() == ".yaml" && entry.path().parent_path().filename() != "launch") files.push_back(entry.path());
  std::ranges::sort(files);
  std::vector<std::string> texts;
  for (const auto& file : files) texts.push_back(read_file(file));
  return texts;
}

TEST(YamlDifferential, ShippedConfigsReadAlike) {
  Tally tally;
  for (const std::string& text : shipped_configs()) compare(text, tally, "shipped");
  EXPECT_GE(tally.accepted, 15);
  EXPECT_EQ(tally.refused, 0);
}

TEST(YamlDifferential, TenThousandConfigsReadAlikeOrAreRefused) {
  const std::vector<std::string> shipped = shipped_configs();
  Tally written, changed;
  for (std::uint32_t round = 0; round < 10'000; ++round) {
    Draws draws(35, round);
    const bool is_written = round % 2 == 0;
    std::string text = is_written ? RandomConfig(draws).text() : mutated(draws.of(shipped), draws);
    if (is_written && draws.one_in(8)) text = mutated(text, draws);
    compare(text, is_written ? written : changed, "round " + std::to_string(round));
    if (HasFatalFailure()) return;
  }
  std::printf("written: %d alike, %d refused (%d by ours alone); shipped and changed: %d alike, %d refused (%d by ours alone)\n",
              written.accepted, written.refused, written.refused_alone, changed.accepted, changed.refused, changed.refused_alone);
  EXPECT_GE(written.accepted + changed.accepted, 5'000);
  EXPECT_GE(written.refused + changed.refused, 500);
}

}  // namespace
}  // namespace earshot
