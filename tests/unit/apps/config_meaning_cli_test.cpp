// SPDX-License-Identifier: Apache-2.0
// Every command that reads a config refuses what could mean several things, and reads numbers alike in files and on the command line.

#include <array>
#include <utility>

#include "sim/base/files.h"
#include "sim/base/text/yaml_parser.h"
#include "tests/support/configs/random_config.h"
#include "tests/support/error_message.h"
#include "tests/support/files/test_data.h"
#include "tests/support/programs/cli.h"
#include "trainer/run/run_config.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;

struct ReadingCommand {
  const char* before;  ///< of the file
  const char* config;  ///< a shipped file of its kind
  const char* behind;
};

constexpr std::array<ReadingCommand, 5> kReadingCommands = {{{"train ", "configs/train/quick.yaml", ""},
                                                             {"scene ", "configs/scenes/small_house.yaml", ""},
                                                             {"sweep ", "configs/sweeps/learning_rate.yaml", ""},
                                                             {"dataset rir ", "configs/datasets/rir.yaml", " --out corpus"},
                                                             {"eval oracle --benchmark ", "configs/benchmarks/quick.yaml", ""}}};

std::vector<std::string> lines_of_file(const std::string& text) {
  std::vector<std::string> lines;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find('\n', at), text.size() - 1);
    lines.push_back(text.substr(at, end + 1 - at));
    at = end + 1;
  }
  return lines;
}

bool is_key_line(const std::string& line) {
  const std::size_t first = line.find_first_not_of(' ');
  return first != std::string::npos && line[first] != '#' && line[first] != '-' && line.find(':') != std::string::npos;
}

/// The file with one fault of the kind at a place that is drawn, the place as messages name it, and what they say.
struct Fault {
  std::string text, place, message;
};

Fault fault_of(std::size_t kind, const std::string& good, Draws& draws) {
  std::vector<std::string> lines = lines_of_file(good);
  std::vector<std::size_t> keys;
  for (std::size_t i = 0; i < lines.size(); ++i)
    if (is_key_line(lines[i])) keys.push_back(i);
  const std::size_t at = draws.of(keys);
  std::string& line = lines[at];
  const std::size_t first = line.find_first_not_of(' '), colon = line.find(line[first] == '"' ? "\":" : ":", first);
  Fault fault{.text = {}, .place = ".yaml:" + std::to_string(at + 1) + ": ", .message = {}};
  switch (kind) {
    case 0:  // twice, directly below or at the end of its section
      line += line.substr(0, colon) + (line[first] == '"' ? "\":" : ":") + " other\n";
      fault.place = ".yaml:" + std::to_string(at + 2) + ": ";
      fault.message = "given twice, in lines " + std::to_string(at + 1) + " and " + std::to_string(at + 2);
      if (line.find(":\n") != std::string::npos || line.find(": ") == std::string::npos) return fault_of(kind, good, draws);
      break;
    case 1: {
      const std::string rest = draws.one_in(2) ? "---\nppo: {learning_rate: 1}\n" : "...\n---\n";
      lines.push_back(rest);
      fault.place = ".yaml:" + std::to_string(lines.size() + (rest[0] == '.' ? 1 : 0)) + ": ";
      fault.message = "second document";
      break;
    }
    case 2:
      line.insert(first, "\t");
      fault.message = "has a tab";
      break;
    case 3:
      line.insert(colon + (line[first] == '"' ? 2 : 1), " !!str");
      fault.message = "has a tag";
      break;
    default:
      line.insert(colon + (line[first] == '"' ? 2 : 1), " *nowhere");
      fault.message = "*nowhere, whose anchor is not set";
      break;
  }
  for (const std::string& part : lines) fault.text += part;
  return fault;
}

constexpr std::size_t kFaultKinds = 5;

TEST(ConfigFaults, OfEveryKindAreNamedWhereverTheyAre) {
  for (const ReadingCommand& command : kReadingCommands) {
    const std::string good = read_file(source_dir() / command.config);
    for (std::uint32_t round = 0; round < 20 * kFaultKinds; ++round) {
      Draws draws(63, round);
      const Fault fault = fault_of(round % kFaultKinds, good, draws);
      const std::string message = error_message([&] { static_cast<void>(parse_yaml(fault.text, {.where = "c.yaml"})); });
      EXPECT_THAT(message, AllOf(HasSubstr(fault.place), HasSubstr(fault.message))) << fault.text;
    }
  }
}

// Each kind by each command.
TEST_F(Cli, EveryConfigIsReadStrictly) {
  for (std::size_t kind = 0; kind < kFaultKinds; ++kind)
    for (std::uint32_t round = 0; round < kReadingCommands.size(); ++round) {
      Draws draws(61, static_cast<std::uint32_t>(kind) * 100 + round);
      const ReadingCommand& command = kReadingCommands[round];
      const Fault fault = fault_of(kind, read_file(source_dir() / command.config), draws);
      const std::string name = write("c" + std::to_string(kind) + std::to_string(round) + ".yaml", fault.text);
      const CliOutcome outcome = earshot(command.before + name + command.behind);
      EXPECT_EQ(outcome.exit_code, 2) << fault.text;
      EXPECT_THAT(outcome.errors, AllOf(HasSubstr(fault.place), HasSubstr(fault.message))) << fault.text;
      EXPECT_EQ(std::count(outcome.errors.begin(), outcome.errors.end(), '\n'), 1) << outcome.errors;
    }
  EXPECT_FALSE(std::filesystem::exists("corpus"));
}

TEST_F(Cli, AMaterialGivenTwiceIsRefused) {
  const std::string text = read_file(source_dir() / "configs/materials.json");
  std::vector<std::size_t> names;
  for (std::size_t at = text.find("\"absorption\""); at != std::string::npos; at = text.find("\"absorption\"", at + 1)) names.push_back(at);
  for (std::uint32_t round = 0; round < 10; ++round) {
    Draws draws(62, round);
    const std::size_t at = draws.of(names);
    std::string changed = text;
    changed.insert(at, "\"absorption\": 0.5, ");
    const std::string line = std::to_string(1 + std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(at), '\n'));
    expect_bad_input("materials " + write("m.json", changed), "absorption is given twice, in lines " + line + " and " + line);
  }
}

/// A run config whose episodes are missing: what reads it says so once every key is right.
std::string run_text(const std::string& keys) {
  return "name: r\nout: " + std::string("r") +
         "\ndata: {train: {file: missing.json.gz, scenes: [\"house:1\"], sounds: [\"synth:alarm:0\"]}}\n" + keys;
}

TEST_F(Cli, NumbersMeanTheSameInFilesAndOnTheCommandLine) {
  const std::array<std::pair<const char*, bool>, 12> numbers = {{{"3e6", true},
                                                                 {"010", true},
                                                                 {"08", true},
                                                                 {"1.0e3", true},
                                                                 {"2.0", true},
                                                                 {"+64", true},
                                                                 {"0x10", false},
                                                                 {"0o17", false},
                                                                 {"1_000", false},
                                                                 {"1.5", false},
                                                                 {".inf", false},
                                                                 {".nan", false}}};
  const auto refusal = [](const std::string& keys, const std::vector<std::string>& overrides) {
    return error_message([&] { static_cast<void>(parse_run_config(run_text(keys), "r.yaml", overrides)); });
  };
  for (const auto& [number, is_good] : numbers) {
    const std::string bad = std::string("total_steps is ") + number + "; use a whole number";
    EXPECT_THAT(refusal(std::string("total_steps: ") + number + "\n", {}), HasSubstr(is_good ? "no error" : bad));
    if (is_good)
      EXPECT_EQ(refusal("", {std::string("seed=") + number}), "no error");
    else
      EXPECT_THAT(refusal("", {std::string("total_steps=") + number}), HasSubstr(bad));
    const std::string options = " --speech nowhere --out " + file("out") + " --count " + number;
    expect_bad_input("dataset convolve nowhere" + options,
                     is_good ? "nowhere" : std::string("'") + number + "' is no whole decimal number");
  }
  // As the command has them, one of each.
  const std::string in_file = write("f.yaml", run_text("total_steps: 010\n")), bad_file = write("b.yaml", run_text("total_steps: 0x10\n"));
  expect_bad_input("train " + in_file + " seed=08", "missing.json.gz");
  expect_bad_input("train " + bad_file, "total_steps is 0x10; use a whole number");
  expect_bad_input("train " + in_file + " total_steps=1_000", "total_steps is 1_000; use a whole number");
  // Eight would be one of the two results of an octal reader: 010 samples wide is ten.
  const CliOutcome ten = earshot("render shoebox:6x3x4 --pose 1,0,2,0 --size 010x010 --out " + file("a.png"));
  EXPECT_EQ(ten.exit_code, 0) << ten.errors;
}

TEST_F(Cli, AnOverrideChangesNoOtherPlaceOfAnAnchor) {
  const std::string config = write("a.yaml", run_text("rollout_steps: &n 16\nenvs_per_worker: *n\n"));
  // Zero is no value of either key.
  expect_bad_input("train " + config + " rollout_steps=0", "override 'rollout_steps=0': rollout_steps is 0");
  expect_bad_input("train " + config + " envs_per_worker=0", "override 'envs_per_worker=0': envs_per_worker is 0");
  expect_bad_input("train " + config + " rollout_steps=32", "missing.json.gz");
}

TEST_F(Cli, ConfigsOfTheFieldAreReadOrRefused) {
  SKIP_WITHOUT_DATA("field/configs");
  const auto config = [](const std::string& name) { return (data_folder() / "field/configs" / name).string(); };
  const std::string missing = "episodes/train.json.gz";
  const std::string end = " out=" + file("run");
  expect_bad_input("train " + config("C01_zoo_float.yaml") + end, missing);
  expect_bad_input("train " + config("base.yaml") + " total_steps=3e6" + end, missing);
  expect_bad_input("train " + config("C02_dup_scalar.yaml") + end, "given twice, in lines ");
  expect_bad_input("train " + config("C03_two_documents.yaml") + end, "begins a second document");
  expect_bad_input("train " + config("C04_alias_hyper.yaml") + " ppo.entropy_coefficient=0.05" + end, missing);
  expect_bad_input("train " + config("C05_octal.yaml") + end, missing);
  expect_bad_input("train " + config("C05_08.yaml") + end, missing);
}

}  // namespace
}  // namespace earshot
