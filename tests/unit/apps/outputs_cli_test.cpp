// SPDX-License-Identifier: Apache-2.0
// Every place that a command is asked to write to is checked before it works: the table of commands and flags is that of their help.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "sim/base/files.h"
#include "sim/base/random.h"
#include "tests/support/programs/cli.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;

struct HelpOption {
  std::string name, type, text;
  [[nodiscard]] bool is_output() const { return type == "OUTFILE" || type == "OUTDIR"; }
};

/// What a command needs to be parsed, outputs apart; IN is a file that is there.  It never comes to its work.
const std::map<std::string, std::string> kNeeded{{"rir", "IN --source 1,1,1 --listener 2,1,1"},
                                                 {"render", "IN --pose 1,0,1,0"},
                                                 {"walk", "IN --poses IN --source 1,1,1 --sound IN"},
                                                 {"scene", "IN"},
                                                 {"dataset episodes", "IN"},
                                                 {"dataset rir", "IN"},
                                                 {"dataset scenes", "IN"},
                                                 {"dataset pano", "IN"},
                                                 {"dataset convolve", "IN --speech IN"},
                                                 {"dataset grid", "IN"},
                                                 {"measure", "IN"},
                                                 {"validate", "IN"},
                                                 {"fit-materials", "IN --measured IN"},
                                                 {"eval", "IN"},
                                                 {"policy", "IN"},
                                                 {"verify", "IN"},
                                                 {"leaderboard", "IN"},
                                                 {"benchmark", "IN"},
                                                 {"replay", "IN"},
                                                 {"sweep", "IN"},
                                                 {"bench bits", "--env IN --episodes IN"}};

class OutputsCli : public Cli {
 protected:
  void SetUp() override {
    Cli::SetUp();
    write("in", "not what any command reads\n");
    std::filesystem::create_directory(folder_ / "folder");
    std::filesystem::create_directory_symlink(folder_, folder_ / "link");
  }
  [[nodiscard]] std::string help(const std::string& command) const {
    const CliOutcome outcome = earshot(command + " --help");
    EXPECT_EQ(outcome.exit_code, 0) << command;
    return outcome.output;
  }
  /// Words of the commands that have no further ones.
  [[nodiscard]] std::vector<std::string> commands(const std::string& above = "") const {
    std::vector<std::string> found;
    std::istringstream lines(help(above));
    bool in_section = false;
    for (std::string line; std::getline(lines, line);) {
      if (line.starts_with("Subcommands:")) in_section = true;
      std::smatch name;
      if (!in_section || !std::regex_search(line, name, std::regex("^  ([a-z][a-z-]*)"))) continue;
      const std::string words = above.empty() ? name[1].str() : above + " " + name[1].str();
      const std::vector<std::string> below = words == "bench" || words == "dataset" ? commands(words) : std::vector{words};
      found.insert(found.end(), below.begin(), below.end());
    }
    return found;
  }
  /// The options that take a value, with the lines that say what for.
  static std::vector<HelpOption> options_of(const std::string& text) {
    std::vector<HelpOption> options;
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line);) {
      std::smatch parts;
      if (std::regex_search(line, parts, std::regex("^  (--[a-z0-9-]+|[A-Z]+) ([A-Z|]+)(=\\S*)?(.*)")))
        options.push_back({parts[1], parts[2], parts[4]});
      else if (std::regex_search(line, std::regex("^  \\S")))
        options.push_back({line, "", ""});  // a flag: what follows is about it
      else if (!options.empty())
        options.back().text += " " + line;
    }
    return options;
  }
  [[nodiscard]] std::string line_of(const std::string& command) const {
    const auto needed = kNeeded.find(command);
    return command + " " + (needed == kNeeded.end() ? "" : std::regex_replace(needed->second, std::regex("IN"), file("in")));
  }
  /// Required outputs, with a good place each, but for one.
  [[nodiscard]] std::string others(const std::vector<HelpOption>& options, const std::set<std::string>& but) const {
    std::string line;
    for (const HelpOption& option : options)
      if (option.is_output() && !but.contains(option.name) && option.text.find("REQUIRED") != std::string::npos)
        line += fmt::format(" {} {}", option.name, file("good" + option.name));
    return line;
  }
  /// No option that writes is forgotten.
  static void expect_declared(const std::string& command, const HelpOption& option) {
    const bool writes = std::regex_search(option.text, std::regex("to write|[Aa]lso write|write it|write the keys|^[^.]*Folder for"));
    const bool is_root = option.name.ends_with("-root");                  // a folder of relative paths that are read
    const bool is_new_keys = command == "keys" && option.name == "FILE";  // read with --show; checked by the command
    const bool is_meant = !writes || option.type.empty() || is_root || is_new_keys || option.is_output();
    EXPECT_TRUE(is_meant) << command << " " << option.name << ": give it type_name(kOutputFile) or kOutputFolder";
  }
  void expect_refused(const std::string& line, const std::string& problem) const {
    expect_bad_input(line, problem);
    EXPECT_EQ(read("in"), "not what any command reads\n") << line;
    std::set<std::string> left;
    for (const auto& entry : std::filesystem::directory_iterator(folder_)) left.insert(entry.path().filename());
    EXPECT_EQ(left, (std::set<std::string>{"folder", "in", "link", "stderr", "stdout"})) << line;
  }
};

TEST_F(OutputsCli, PlacesAreCheckedBeforeTheWorkOfEveryCommand) {
  std::uint32_t row = 0;
  std::size_t num_outputs = 0;
  for (const std::string& command : commands()) {
    const std::vector<HelpOption> options = options_of(help(command));
    std::vector<HelpOption> outputs;
    for (const HelpOption& option : options) {
      expect_declared(command, option);
      if (option.is_output()) outputs.push_back(option);
    }
    num_outputs += outputs.size();
    for (const HelpOption& output : outputs) {
      const std::string start = line_of(command) + others(options, {output.name}) + " " + output.name + " ";
      if (output.type == "OUTFILE")
        expect_refused(start + file("folder"), "is a folder");
      else
        expect_refused(start + file("in"), "but ");
      // One of three other faults, drawn for each flag.
      const RandomStream random(7, Purpose::test, row++);
      const float drawn = random.uniform(0);
      if (drawn < 0.33f)
        expect_refused(start + file("in") + "/deep/x", "is not a folder");
      else if (drawn < 0.67f || line_of(command).find(file("in")) == std::string::npos)
        expect_refused(start + "/proc/deep/x", "cannot be written in /proc");
      else if (output.type == "OUTFILE")
        expect_refused(start + file("link/./in"), "would replace what");
    }
    for (std::size_t i = 1; i < outputs.size(); ++i)
      expect_refused(line_of(command) + others(options, {outputs[i - 1].name, outputs[i].name}) +
                         fmt::format(" {} {} {} {}", outputs[i - 1].name, file("new"), outputs[i].name, file("link/folder/../new")),
                     "two outputs would replace each other");
  }
  EXPECT_GT(num_outputs, 35u);
}

// What several responses are named by, and what is found only in the files that are read.
TEST_F(OutputsCli, NamesThatACommandMakesAreCheckedToo) {
  const std::string rir = "rir shoebox:4x3x3 --source 1,1,1 --source 2,1,1 --listener 3,1,2 --out " + file("a.wav");
  expect_refused(rir + " --metrics " + file("a.s1.l0.wav"), "two outputs would replace each other");
  expect_refused(rir + " --plot x.svg --metrics " + file("a.s0.l0.svg"), "two outputs would replace each other");
  expect_refused(rir + " --components --metrics " + file("a.s1.l0.late.wav"), "two outputs would replace each other");
  std::filesystem::create_directory(file("folder") + "/speech");
  expect_refused("dataset convolve " + file("in") + " --speech " + file("folder") + " --out " + file("folder/speech/x"),
                 "reads as a whole");
  expect_bad_input("keys " + file("in") + "/key", "is not a folder");
}

}  // namespace
}  // namespace earshot
