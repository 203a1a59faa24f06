// SPDX-License-Identifier: Apache-2.0
// What one text means, and what is refused because it could mean several things; places, depths and names are drawn.
#include "sim/base/text/yaml_parser.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"
#include "sim/base/text/config_tree.h"
#include "sim/base/text/json_keys.h"
#include "tests/support/configs/random_config.h"

namespace earshot {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

std::string refusal_of_yaml(const std::string& text, const std::vector<std::string>& overrides = {}) {
  try {
    static_cast<void>(ConfigReader::from_text(text, "a.yaml", overrides));
  } catch (const InputError& error) {
    EXPECT_EQ(std::string_view(error.what()).find('\n'), std::string_view::npos);
    return error.what();
  }
  return "no InputError";
}

/// Maps within maps, `depth` deep and each with some keys; `inner` stands in the innermost.  lines: set to the lines before `inner`.
std::string nested_maps(Draws& draws, std::uint32_t depth, const std::function<std::string(const std::string&)>& inner, std::string& path) {
  std::string text, indent;
  for (std::uint32_t level = 0; level < depth; ++level) {
    for (std::uint32_t i = draws.below(3); i > 0; --i) text += indent + "k" + std::to_string(level) + std::to_string(i) + ": 1\n";
    const std::string name = "s" + std::to_string(draws.below(100));
    text += indent + name + ":\n";
    path += name + ".";
    indent += std::string(1 + draws.below(4), ' ');
  }
  return text + inner(indent);
}

int lines_of(const std::string& text) { return static_cast<int>(std::count(text.begin(), text.end(), '\n')); }

TEST(YamlMeaning, AKeyTwiceIsRefusedWithBothLines) {
  for (std::uint32_t round = 0; round < 200; ++round) {
    Draws draws(51, round);
    std::string path, text;
    int first = 0, second = 0;
    text = nested_maps(
        draws, draws.below(5),
        [&](const std::string& indent) {
          std::string keys;
          const std::uint32_t count = 2 + draws.below(6), again = 1 + draws.below(count - 1), original = draws.below(again);
          for (std::uint32_t i = 0; i < count; ++i) {
            const std::string name = i == again ? "key" + std::to_string(original) : "key" + std::to_string(i);
            if (i == original) first = lines_of(keys);
            if (i == again) second = lines_of(keys);
            const std::string quoted = draws.one_in(4) ? "\"" + name + "\"" : name;
            keys += indent + quoted + (draws.one_in(3) ? ":\n" + indent + "  part: 1\n" : draws.one_in(2) ? ": [1,\n  2]\n" : ": 1\n");
            if (draws.one_in(4)) keys += "\n# a comment\n";
          }
          path += "key" + std::to_string(original);
          return keys;
        },
        path);
    const std::size_t at = text.find("key");
    const int before = lines_of(text.substr(0, at));
    const std::string lines = "in lines " + std::to_string(before + first + 1) + " and " + std::to_string(before + second + 1);
    EXPECT_THAT(refusal_of_yaml(text), HasSubstr(path + " is given twice, " + lines)) << text;
    EXPECT_THAT(refusal_of_yaml(text), StartsWith("a.yaml:" + std::to_string(before + second + 1) + ":")) << text;
  }
  EXPECT_THAT(refusal_of_yaml("a: {b: 1, c: 2, b: 3}\n"), HasSubstr("a.yaml:1: a.b is given twice"));
  EXPECT_THAT(refusal_of_yaml("a:\n  - {b: 1}\n  - b: 1\n    b: 2\n"), HasSubstr("a.yaml:4: a[1].b is given twice, in lines 3 and 4"));
}

TEST(YamlMeaning, AKeyOfAMaterialTwiceIsRefused) {
  check_unique_keys(R"({"a": [{"b": 1}, {"b": "{\"b\": 1, \"b\": 2}"}], "b": 2})", "m.json");
  for (std::uint32_t round = 0; round < 50; ++round) {
    Draws draws(52, round);
    const std::uint32_t count = 2 + draws.below(6), item = draws.below(count), gap = draws.below(3);
    std::string text = "{\n\"list\": [\n";
    for (std::uint32_t i = 0; i < count; ++i)
      text += std::string(i > 0 ? ",\n" : "") + "{\"name\": \"n\"," +
              (i == item ? std::string(gap, '\n') + "\"name\": \"m\"" : "\"x\": 1") + "}";
    const std::string line = "m.json:" + std::to_string(3 + item + gap) + ": list.name is given twice";
    EXPECT_THAT([&] { check_unique_keys(text + "]}", "m.json"); }, testing::ThrowsMessage<InputError>(HasSubstr(line))) << text;
  }
}

TEST(YamlMeaning, OneDocumentIsRead) {
  for (const char* good : {"---\na: 1\n", "a: 1\n...\n", "--- # begins\na: 1\n...\n# ends\n", "a: '---'\n", "a: --- b\n", "", "---\n"})
    EXPECT_EQ(refusal_of_yaml(good), "no InputError") << good;
  for (std::uint32_t round = 0; round < 50; ++round) {
    Draws draws(53, round);
    std::string path, text = nested_maps(
                          draws, draws.below(4), [](const std::string&indent) { return indent + "a: 1\n"; }, path);
    const int line = lines_of(text) + 1;
    if (draws.one_in(3)) text.insert(0, "# head\n---\n");
    const int more = lines_of(text) + 1 - line;
    text += draws.one_in(3) ? "...\n---\nb: 2\n" : draws.one_in(2) ? "---\n" : "--- # next\nb: 2\n";
    EXPECT_THAT(refusal_of_yaml(text), HasSubstr("begins a second document")) << text;
    EXPECT_THAT(refusal_of_yaml(text), testing::AnyOf(StartsWith("a.yaml:" + std::to_string(line + more)),
                                                      StartsWith("a.yaml:" + std::to_string(line + more + 1))));
  }
}

/// a.b.c of a config tree as text.
std::string value_of(const YamlNode& root, std::string path) {
  const YamlNode* node = &root;
  for (std::size_t dot = path.find('.'); node != nullptr && dot != std::string::npos; dot = path.find('.')) {
    node = node->find(path.substr(0, dot));
    path.erase(0, dot + 1);
  }
  node = node == nullptr ? nullptr : node->find(path);
  return node == nullptr ? "(absent)" : yaml_line(*node);
}

// Tried with a run whose training and test set shared an anchor: an override of one moved both.
TEST(YamlMeaning, AnOverrideChangesItsOwnPlaceAlone) {
  for (std::uint32_t round = 0; round < 100; ++round) {
    Draws draws(54, round);
    const std::uint32_t places = 2 + draws.below(6), changed = draws.below(places), depth = 1 + draws.below(3);
    std::string map, deep;
    for (std::uint32_t i = 0; i < depth; ++i) deep += "d" + std::to_string(i) + (i + 1 < depth ? "." : "");
    for (std::uint32_t i = 0; i < depth; ++i) map += "{d" + std::to_string(i) + ": ";
    map += "1" + std::string(depth, '}');
    std::string text = "p0: &x " + map + "\n";
    for (std::uint32_t i = 1; i < places; ++i) text += "p" + std::to_string(i) + (draws.one_in(3) ? ": {<<: *x}\n" : ": *x\n");
    bool has_keys = false;
    const YamlNode root = load_config_tree(text, "a.yaml", {"p" + std::to_string(changed) + "." + deep + "=2", "p0.new=3"}, has_keys);
    for (std::uint32_t i = 0; i < places; ++i) {
      EXPECT_EQ(value_of(root, "p" + std::to_string(i) + "." + deep), i == changed ? "2" : "1") << text;
      EXPECT_EQ(value_of(root, "p" + std::to_string(i) + ".new"), i == 0 ? "3" : "(absent)");
    }
  }
}

TEST(YamlMeaning, MergeKeysFillInWhatIsNotThere) {
  bool has_keys = false;
  const YamlNode root = load_config_tree(
      "a: &a {x: 1, y: 1}\nb: &b {y: 2, z: 2}\nc: {<<: *a, y: 3}\nd: {y: 4, <<: [*b, *a]}\ne: {'<<': 5}\nf: {<<: {<<: *a, w: 6}}\n",
      "a.yaml", {}, has_keys);
  EXPECT_EQ(value_of(root, "c.x") + value_of(root, "c.y"), "13");
  EXPECT_EQ(value_of(root, "d.x") + value_of(root, "d.y") + value_of(root, "d.z"), "142");
  EXPECT_EQ(value_of(root, "e.<<"), "5");
  EXPECT_EQ(value_of(root, "f.x") + value_of(root, "f.w"), "16");
  EXPECT_EQ(root.find("c")->items.size(), 2u);
  EXPECT_THAT(refusal_of_yaml("a: 1\nb:\n  <<: 3\n"), HasSubstr("a.yaml:3: << merges something else than maps"));
  EXPECT_THAT(refusal_of_yaml("a: &a {}\nb: {<<: *a, <<: *a}\n"), HasSubstr("b.<< is given twice"));
  EXPECT_THAT(refusal_of_yaml("a: &name {}\nb: *nam\n"),
              HasSubstr("a.yaml:2: has the alias *nam, whose anchor is not set above; did you mean *name?"));
  EXPECT_THAT(refusal_of_yaml("a: &n 1\nb: &n 2\n"), HasSubstr("a.yaml:2: sets the anchor &n again, after line 1"));
  EXPECT_THAT(refusal_of_yaml("a: &n [*n]\n"), HasSubstr("*n, whose anchor is not set"));
}

TEST(YamlMeaning, CopiesAndLevelsAreBounded) {
  std::string laughs = "l0: &l0 [lol, lol]\n", long_text = "t: &t " + std::string(1 << 20, 'x') + "\nlist:\n";
  for (int i = 1; i < 40; ++i)
    laughs +=
        "l" + std::to_string(i) + ": &l" + std::to_string(i) + " [*l" + std::to_string(i - 1) + ", *l" + std::to_string(i - 1) + "]\n";
  for (int i = 0; i < 1000; ++i) long_text += "  - *t\n";
  EXPECT_THAT(refusal_of_yaml(laughs), HasSubstr("copies more than 16 MB by aliases"));
  EXPECT_THAT(refusal_of_yaml(long_text), HasSubstr("copies more than 16 MB by aliases"));
  for (const int levels : {kMaxYamlLevels - 2, kMaxYamlLevels + 2, 100'000}) {
    const auto repeated = [&](const std::string& part) {
      std::string all;
      for (int i = 0; i < levels; ++i) all += part;
      return all;
    };
    std::string block;
    for (int i = 0; i < std::min(levels, 200); ++i) block += std::string(static_cast<std::size_t>(i), ' ') + "k:\n";
    for (const std::string& text :
         {"a: " + repeated("[") + repeated("]"), "a: " + repeated("{a: ") + repeated("}"), "a:\n " + repeated("- ") + "1", block})
      EXPECT_EQ(refusal_of_yaml(text) == "no InputError", levels < kMaxYamlLevels) << levels << text.substr(0, 20);
  }
  std::string path = "a";
  for (int i = 0; i < 1000; ++i) path += ".a";
  EXPECT_THAT(refusal_of_yaml("b: 1\n", {path + "=1"}), HasSubstr("has too many levels"));
}

TEST(YamlMeaning, WhatLooksAlikeIsReadAlikeOrRefusedInOneLine) {
  bool has_keys = false;
  for (const std::string text : {"\xEF\xBB\xBF"
                                 "a: 1\r\nb:\r\n  c: x y\r\n",
                                 "a: 1\nb:\n  c: x\n    y\n", "a: 1\nb: {c: 'x y'}", "{\"a\":1,\"b\":{\"c\":\"x y\"}}"}) {
    const YamlNode root = load_config_tree(text, "a.yaml", {}, has_keys);
    EXPECT_EQ(value_of(root, "a") + value_of(root, "b.c"), "1x y") << text;
  }
  const std::vector<std::pair<std::string, std::string>> refused = {
      {"a:\t1\n", "a.yaml:1: has a tab outside of quotes"},
      {"a:\n\tb: 1\n", "a.yaml:2: has a tab"},
      {"a: 1\rb: 2\n", "a.yaml:1: has a carriage return"},
      {"a: 1\nb: \x01\n", "a.yaml:2: has a character that does not belong"},
      {"a: 1\nb: \xE2\x80\xA8\n", "a.yaml:2: has a character"},
      {"a: 1\n\xEF\xBB\xBF"
       "b: 1\n",
       "a.yaml:2: has a character"},
      {"a: 1\n  b: 2\n", "a.yaml:2: has a second ':' in the line of a key, or a key that is indented like a part of the value above"},
      {"a: [x?y]\n", "a.yaml:1: has a '?' within [ ]"},
      {"a: {b: 1, c?d: 1}\n", "a.yaml:1: has a '?' within [ ]"},
      {"a: 1\nb: - 2\n", "a.yaml:2: has a '-' where a value"},
      {"a: [1,\n  , 2]\n", "a.yaml:2: has no key or value where one begins"},
      {"- a\nb: 1\n", "a.yaml:2: is indented differently"},
      {"a: 'x' y\n", "a.yaml:1: is indented differently from the lines above, or has text behind the end of a value"},
      {"a: &b!c 1\n", "a.yaml:1: has an anchor without a plain name"},
      {"a: !x!y 1\n", "a.yaml:1: has a tag"},
      {"%FOO\n---\na: 1\n", "a.yaml:1: has a directive"},
      {"a: {: 1}\n", "a.yaml:1: has no key or value where one begins"},
      {"a: \"x\\_\"\n", "a.yaml:1: has an escape"},
      {"a:\n  -\n  |\n   x\n", "a.yaml:3: has a '|' at the beginning of a line"},
      {"a: >+\n  x\n", "a.yaml:1: has '>+' before a text of several lines"},
      {"a: |2\n    x\n", "a.yaml:1: has '|2' before a text of several lines"},
      {"a: [b :]\n", "a.yaml:1: has a ':'"},
      {"a: 1\nb\n", "a.yaml:2: has a line without ':'"},
      {"a:\n  b: 1\n c: 2\n", "a.yaml:3: is indented differently"},
      {"a: b: 1\n", "a.yaml:1: has a second ':'"},
      {"a: !!str 3\n", "a.yaml:1: has a tag"},
      {"a: !!int 3.5\n", "a.yaml:1: has a tag !!int before '3.5'"},
      {"a: !!float x\n", "a.yaml:1: has a tag !!float before 'x'"},
      {"%YAML 1.2\n---\na: 1\n", "a.yaml:1: has a directive"},
      {"? a\n: 1\n", "a.yaml:1: has a key behind '?'"},
      {"[a]: 1\n", "a.yaml:1:"},
      {"a: 'x\nb: 1\n", "a.yaml:1: has a quote that is not closed"},
      {"a: [1, 2\nb: 3\n", "a.yaml:"},
      {"a: {b}\n", "a.yaml:1: has 'b' without ': value'"},
      {"a: [b: 1]\n", "a.yaml:1: has a ':' behind a value"},
      {"a: @x\n", "a.yaml:1: has a value or key that begins with '@'"},
      {"a: \"\\q\"\n", "a.yaml:1: has an escape"},
      {"a: \"\\ud800\"\n", "a.yaml:1: has an escape"},
      {"a: 1#x\nb: 'x'#y\n", "a.yaml:2: has a '#' directly behind a value"},
      {"- a\n", "a.yaml: is not a map"},
  };
  for (const auto& [text, message] : refused) EXPECT_THAT(refusal_of_yaml(text), StartsWith(message)) << text;
  EXPECT_THAT(refusal_of_yaml("a: 1\n", {"a=[1"}), StartsWith("override 'a=[1': has a bracket without its ']'"));
  EXPECT_THAT(refusal_of_yaml("a: 1\n", {"a={b: 1, b: 2}"}), StartsWith("override 'a={b: 1, b: 2}': b is given twice"));
  EXPECT_THAT(refusal_of_yaml("x: &x 1\n", {"a=*x"}), HasSubstr("*x, whose anchor is not set"));
}

// The same numbers from a file and from the command line, at places that are drawn.
TEST(YamlMeaning, NumbersMeanTheSameInFilesAndOverrides) {
  const std::vector<std::pair<std::string, std::optional<int>>> numbers = {
      {"010", 10},  {"0050", 50},          {"08", 8},         {"3e6", 3'000'000}, {"1.0e+3", 1000}, {"2.0", 2},  {"+7", 7},
      {"0x10", {}}, {"!!float 1e3", 1000}, {"!!int 010", 10}, {"0o17", {}},       {"1_000", {}},    {"1.5", {}}, {"1e-1", {}},
      {".inf", {}}, {".nan", {}},          {"1:30", {}},      {"1e10", {}}};
  constexpr About about("A number of this test.");
  for (const auto& [text, expected] : numbers)
    for (const bool is_override : {false, true}) {
      int value = -1;
      std::string message;
      try {
        const std::vector<std::string> overrides = is_override ? std::vector<std::string>{"s.n=" + text} : std::vector<std::string>{};
        ConfigReader reader = ConfigReader::from_text(is_override ? "s: {n: 1}\n" : "s:\n  n: " + text + "\n", "a.yaml", overrides);
        ConfigReader section = reader.child("s", about);
        section.read("n", value, about);
      } catch (const InputError& error) {
        message = error.what();
      }
      const std::string refusal = (is_override ? "override 's.n=" + text + "'" : "a.yaml:2") + ": s.n is " + text + "; use a whole number";
      EXPECT_EQ(value, expected.value_or(-1)) << text;
      EXPECT_TRUE(expected ? message.empty() : message.starts_with(refusal)) << text << ": " << message;
      const bool has_hint = text == "0x10" || text == "0o17" || text == "1_000";
      EXPECT_EQ(message.find("numbers are decimal") != std::string::npos, has_hint) << text;
    }
}

}  // namespace
}  // namespace earshot
