// SPDX-License-Identifier: Apache-2.0
#include "sim/base/output_paths.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <set>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/random.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::IsEmpty;
using Kind = OutputPath::Kind;

std::string refusal_of(const std::vector<OutputPath>& outputs, const std::vector<InputPath>& inputs = {}) {
  return message_of<InputError>([&] { check_outputs(outputs, inputs); });
}

std::set<std::string> all_below(const std::string& folder) {
  std::set<std::string> names;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) names.insert(entry.path().string());
  return names;
}

TEST(OutputPaths, PlacesThatCannotBeWrittenAreNamedAndLeftAlone) {
  const TempFolder folder;
  const std::string file = folder.write("file", "kept");
  std::filesystem::create_directory(folder / "empty");
  const auto before = all_below(folder / "");
  EXPECT_THAT(refusal_of({{"--out", folder / "new"}, {"--json", folder / "a/b/c"}, {"--svg", file}}), IsEmpty());
  EXPECT_THAT(refusal_of({{"--out", folder / "corpus", Kind::folder}, {"--store", folder / "empty", Kind::folder}}), IsEmpty());
  EXPECT_THAT(refusal_of({{"--out", folder / "empty"}}), AllOf(HasSubstr("--out " + (folder / "empty")), HasSubstr("is a folder")));
  EXPECT_THAT(refusal_of({{"--out", file, Kind::folder}}), HasSubstr("is a file, but a folder is written there"));
  EXPECT_THAT(refusal_of({{"--out", file + "/x/y"}}), HasSubstr("is not a folder"));
  EXPECT_THAT(refusal_of({{"--out", "/dev/null"}}), HasSubstr("is not a regular file"));
  // No caller, root included, makes files in /proc, or one of so long a name.
  for (const char* place : {"/proc/x", "/proc/x/y/z"}) EXPECT_THAT(refusal_of({{"--out", place}}), HasSubstr("cannot be written in /proc"));
  EXPECT_THAT(refusal_of({{"--out", "/proc/x", Kind::folder}}), HasSubstr("cannot be written in /proc"));
  EXPECT_THAT(refusal_of({{"--out", folder / std::string(300, 'x')}}), HasSubstr("File name too long"));
  EXPECT_THAT(refusal_of({{"--out", ""}}), HasSubstr("names no file"));
  EXPECT_EQ(all_below(folder / ""), before);
  EXPECT_EQ(read_file(file), "kept");
}

// One file under names that are drawn: through ".", "..", doubled slashes and a link to the folder.
TEST(OutputPaths, OnePlaceUnderTwoNamesIsFound) {
  const TempFolder folder;
  std::filesystem::create_directories(folder / "a/b");
  std::filesystem::create_directory_symlink(folder / "a", folder / "link");
  const std::vector<std::string> ways{"a", "./a", "link", "a/b/..", "link/b/..", "a//.", "link/./b/../b/.."};
  for (const char* name : {"new.json", "there.json"}) {
    if (std::string(name) == "there.json") folder.write("a/there.json", "1");
    for (std::uint32_t i = 0; i < 40; ++i) {
      const RandomStream random(35, Purpose::test, i);
      const auto draw = [&](std::uint32_t at) {
        return ways[static_cast<std::size_t>(random.uniform(at) * static_cast<float>(ways.size())) % ways.size()];
      };
      const std::string first = folder / (draw(0) + "/" + name), second = folder / (draw(1) + "/" + name);
      EXPECT_TRUE(is_same_place(first, second)) << first << " " << second;
      EXPECT_THAT(refusal_of({{"--out", first}, {"--json", second}}), HasSubstr("two outputs would replace each other"));
      EXPECT_THAT(refusal_of({{"--out", first}}, {{.option = "--episodes", .path = second}}),
                  HasSubstr("would replace what --episodes reads"));
      EXPECT_THAT(refusal_of({{"--out", first}, {"--json", second + ".other"}}), IsEmpty());
      EXPECT_THAT(refusal_of({{"--out", first}, {"--json", second + "/below"}}), HasSubstr("is"));
    }
  }
}

TEST(OutputPaths, NothingIsWrittenInAFolderThatIsReadAsAWhole) {
  const TempFolder folder;
  std::filesystem::create_directories(folder / "speech/talker");
  std::filesystem::create_directory_symlink(folder / "speech", folder / "link");
  const InputPath whole{.option = "--speech", .path = folder / "speech", .is_read_whole = true}, part{"AGENT", folder / "speech"};
  for (const char* place : {"speech/out.json", "speech/talker/new/out.json", "link/out.json"}) {
    EXPECT_THAT(refusal_of({{"--out", folder / place}}, {whole}), HasSubstr("which --speech reads as a whole")) << place;
    EXPECT_THAT(refusal_of({{"--out", folder / place}}, {part}), IsEmpty()) << place;
  }
  EXPECT_THAT(refusal_of({{"--out", folder / "speech", Kind::folder}}, {whole}), HasSubstr("would replace"));
  EXPECT_THAT(refusal_of({{"--out", folder / "speech_out", Kind::folder}}, {whole}), IsEmpty());
}

}  // namespace
}  // namespace earshot
