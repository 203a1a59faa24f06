// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/config_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <optional>

#include "sim/base/random.h"

namespace earshot {
namespace {

using testing::HasSubstr;

constexpr About kAbout("A key of this test.");

std::string message_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const InputError& error) {
    return error.what();
  }
  return "no InputError";
}

TEST(ConfigReader, ReadsValuesAndKeepsDefaults) {
  ConfigReader reader = ConfigReader::from_text("lr: 0.5\nname: x\nchild: {n: 3}\n", "test");
  double lr = 1, other = 7;
  std::string name;
  reader.read("lr", lr, kAbout);
  reader.read("other", other, kAbout);
  reader.read("name", name, kAbout);
  ConfigReader child = reader.child("child", kAbout);
  int n = 0;
  child.read("n", n, kAbout);
  child.finish();
  reader.finish();
  EXPECT_EQ(lr, 0.5);
  EXPECT_EQ(other, 7);
  EXPECT_EQ(name, "x");
  EXPECT_EQ(n, 3);
}

TEST(ConfigReader, UnknownKeyNamesTheNearest) {
  ConfigReader reader = ConfigReader::from_text("ppo: {learning_rat: 1}", "run.yaml");
  ConfigReader ppo = reader.child("ppo", kAbout);
  double rate = 0;
  ppo.read("learning_rate", rate, kAbout);
  const auto message = message_of([&] { ppo.finish(); });
  EXPECT_THAT(message, HasSubstr("run.yaml"));
  EXPECT_THAT(message, HasSubstr("ppo.learning_rat"));
  EXPECT_THAT(message, HasSubstr("did you mean 'learning_rate'"));
}

TEST(ConfigReader, WrongTypesAndChoicesAreNamed) {
  ConfigReader reader = ConfigReader::from_text("a: word\nb: 1.5\nc: up", "test");
  int number = 0;
  EXPECT_THAT(message_of([&] { reader.read("a", number, kAbout); }),
              HasSubstr("test:1: a is word; use a whole number from -2,147,483,648 to 2,147,483,647"));
  EXPECT_THAT(message_of([&] { reader.read("b", number, kAbout); }), HasSubstr("test:2: b is 1.5; use a whole number"));
  EXPECT_THAT(message_of([&] {
                reader.read_choice<int>("c", number, {{"x", 0}, {"y", 1}}, kAbout);
              }),
              HasSubstr("test:3: c is up; use x or y"));
  EXPECT_THAT(message_of([&] { reader.read_required("missing", number, Allowed::any(), kAbout); }), HasSubstr("test: missing: is missing"));
  EXPECT_THAT(message_of([&] { (void)reader.child("a", kAbout); }), HasSubstr("test:1: a: must be a map"));
}

TEST(ConfigReader, OverridesReplaceAndCreate) {
  ConfigReader reader = ConfigReader::from_text("ppo: {lr: 1}\nn: 2", "test", {"ppo.lr=0.25", "new.deep.key=[1, 2]", "n=5"});
  ConfigReader ppo = reader.child("ppo", kAbout);
  double lr = 0;
  ppo.read("lr", lr, kAbout);
  EXPECT_EQ(lr, 0.25);
  ConfigReader fresh = reader.child("new", kAbout);
  ConfigReader deep = fresh.child("deep", kAbout);
  std::vector<int> list;
  deep.read("key", list, kAbout);
  EXPECT_EQ(list, (std::vector<int>{1, 2}));
  int n = 0;
  reader.read("n", n, kAbout);
  EXPECT_EQ(n, 5);
  EXPECT_THAT(message_of([] { ConfigReader::from_text("a: 1", "test", {"novalue"}); }), HasSubstr("key=value"));
  EXPECT_THAT(message_of([] { ConfigReader::from_text("a: 1", "test", {"a.b=2"}); }), HasSubstr("is a value, not a map"));
}

TEST(ConfigReader, BrokenYamlSaysWhere) {
  EXPECT_THAT(message_of([] { ConfigReader::from_text("a: [1, 2\nb: 3", "run.yaml"); }), HasSubstr("run.yaml:"));
  EXPECT_THAT(message_of([] { ConfigReader::from_text("- 1\n- 2", "run.yaml"); }), HasSubstr("not a map"));
  EXPECT_THAT(message_of([] { ConfigReader::from_file("/nonexistent/x.yaml"); }), HasSubstr("no such file"));
}

// Bytes of a valid text changed at random: every outcome is a value or an InputError, never another exception or a crash.
// Found by fuzzing: half a UTF-16 text became characters that the resolved config could not be read with again.
TEST(ConfigReader, TextIsUtf8OrRefused) {
  using namespace std::string_literals;
  for (const std::string& good : {"n: \u00e9\n"s, "n: \u20ac\n"s, "n: \U0001F600\n"s, "\xEF\xBB\xBFn: x\n"s}) {
    ConfigReader reader = ConfigReader::from_text(good, "good");
    std::string value;
    reader.read("n", value, kAbout);
    EXPECT_FALSE(value.empty()) << good;
  }
  const std::string bad[] = {"n: \xE9\n"s,          // Latin 1
                             "\xFE\xFF\0n\0:\0 "s,  // UTF-16
                             "n: \xC0\x80\n"s,      // longer than it need be
                             "n: \xED\xA0\x80\n"s,  // a surrogate
                             "n: \xF4\x90\x80\x80\n"s,
                             "n: \xE2\x82"s,
                             "n: \x80\n"s,
                             "n: a\0b\n"s};
  for (const std::string& text : bad) {
    EXPECT_THAT(message_of([&] { ConfigReader::from_text(text, "bad.yaml"); }), HasSubstr("bad.yaml: is not UTF-8 text")) << text;
  }
  EXPECT_THAT(message_of([&] { ConfigReader::from_text("n: x\n", "run.yaml", {"n=\xFF"}); }), HasSubstr("is not UTF-8 text"));
  for (const std::string escape : {"\\N", "\\L", "\\0", "\\x07", "\\uFEFF"}) {
    EXPECT_THAT(message_of([&] { ConfigReader::from_text("n: \"a" + escape + "\"\n", "run.yaml"); }),
                HasSubstr("run.yaml:1: has an escape"))
        << escape;
  }
}

TEST(ConfigReader, MutatedTextNeverEscapesAsAnotherException) {
  const std::string valid =
      "mesh: room.glb\nair: {temperature_c: 20, humidity_percent: 50}\nassign:\n  \"wall*\": brick\nlist: [1, 2, 3]\n";
  for (std::uint32_t round = 0; round < 2000; ++round) {
    const RandomStream random(11, Purpose::test, round);
    std::string text = valid;
    const std::uint32_t changes = 1 + random.below(4, 0);
    for (std::uint32_t i = 0; i < changes; ++i)
      text[random.below(static_cast<std::uint32_t>(text.size()), 1 + 2 * i)] = static_cast<char>(random.below(256, 2 + 2 * i));
    try {
      ConfigReader reader = ConfigReader::from_text(text, "fuzz");
      ConfigReader air = reader.child("air", kAbout);
      double temperature = 0;
      air.read("temperature_c", temperature, kAbout);
      air.finish();
      std::string mesh;
      reader.read("mesh", mesh, kAbout);
      reader.finish();
    } catch (const InputError&) {
    }
  }
}

TEST(ConfigReader, ARecorderNotesEveryKeyWithItsValue) {
  ConfigReader recorder = ConfigReader::recorder();
  int rays = 7;
  float gain = 0.1f;
  std::string name = "auto: yes";
  bool on = true;
  recorder.read("rays", rays, kAbout);
  recorder.read("name", name, kAbout);
  recorder.read_choice<bool>("switch", on, {{"off", false}, {"on", true}}, kAbout);
  ConfigReader child = recorder.child("sound", kAbout);
  child.read("gain", gain, kAbout);
  child.finish();
  recorder.finish();
  EXPECT_EQ(rays, 7);

  rays = 0, gain = 0, name = "", on = false;
  ConfigReader reader = ConfigReader::from_text(recorder.effective(), "recorded");
  reader.read_required("rays", rays, Allowed::any(), kAbout);
  reader.read_required("name", name, Allowed::any(), kAbout);
  reader.read_choice<bool>("switch", on, {{"off", false}, {"on", true}}, kAbout);
  ConfigReader sound = reader.child("sound", kAbout);
  sound.read_required("gain", gain, Allowed::any(), kAbout);
  EXPECT_EQ(rays, 7);
  EXPECT_EQ(gain, 0.1f);
  EXPECT_EQ(name, "auto: yes");
  EXPECT_TRUE(on);
}

struct Room {
  float length_s = 0.5f;
  int rays = 64;
  std::vector<float> height_m = {1, 2};
  std::optional<double> lid_m = {};
  std::string name = "room";
};

void read(ConfigReader& reader, Room& room) {
  reader.read("length_s", room.length_s, Allowed::above(0).up_to(0.7).or_word("auto", 0), "Length of the room's response.");
  reader.read("rays", room.rays, Allowed::between(1, 1 << 20).because("each carries energy"), "Rays of the room.");
  ConfigReader place = reader.child("place", "Where things stand.");
  place.read("height_m", room.height_m, Allowed::between(0, 3).interval(), "Least and largest height.");
  place.finish();
  reader.read("lid_m", room.lid_m, Allowed::any(), "Height of the lid.");
  reader.read_required("name", room.name, Allowed::text("a name"), "Name of the room.");
}

std::string refusal_of(const std::string& yaml, const std::vector<std::string>& overrides = {}) {
  return message_of([&] {
    ConfigReader reader = ConfigReader::from_text(yaml, "configs/a.yaml", overrides);
    Room room;
    read(reader, room);
    reader.finish();
  });
}

TEST(ConfigReader, ValuesOutsideTheirRangeNameFileLineKeyValueAndRange) {
  EXPECT_EQ(refusal_of("name: a\nrays: 1e12\n"),
            "configs/a.yaml:2: rays is 1e12; use a whole number from 1 to 1,048,576: each carries energy");
  EXPECT_EQ(refusal_of("name: a\nlength_s: 0.71\n"), "configs/a.yaml:2: length_s is 0.71; use a number above 0 and at most 0.7 s, or auto");
  EXPECT_EQ(refusal_of("name: a\nplace:\n  height_m: [2, 1]\n"),
            "configs/a.yaml:3: place.height_m is [2, 1]; use a list of 2 numbers from 0 to 3 m, in increasing order");
  EXPECT_EQ(refusal_of("name: a\nlid_m: .inf\n"), "configs/a.yaml:2: lid_m is .inf; use a finite number");
  EXPECT_EQ(refusal_of("rays: 3\n"), "configs/a.yaml: name: is missing");
  EXPECT_EQ(refusal_of("name: a\n\nray: 3\n"), "configs/a.yaml:3: ray: unknown key; did you mean 'rays'?");
  EXPECT_EQ(refusal_of("name: a\nrays: 5\n", {"place.height_m=[1, 2, 3]"}),
            "override 'place.height_m=[1, 2, 3]': place.height_m is [1, 2, 3]; use a list of 2 numbers from 0 to 3 m, in increasing order");
  EXPECT_EQ(refusal_of("", {"name=a", "rays=0"}),
            "configs/a.yaml rays=0: rays is 0; use a whole number from 1 to 1,048,576: each carries energy");
  // A bound is taken in the type of the value: 0.7 as a float is above 0.7 as a double.
  for (const char* good : {"name: a\nlength_s: 0.7\n", "name: a\nlength_s: auto\n", "name: a\nlength_s: 0\n", "name: a\nrays: 1048576\n"})
    EXPECT_EQ(refusal_of(good), "no InputError") << good;
}

TEST(ConfigReader, ADescriberCollectsWhatIsDeclared) {
  const std::vector<ConfigKey> keys = keys_of<Room>();
  ASSERT_EQ(keys.size(), 6u);
  EXPECT_EQ(keys[0].name, "length_s");
  EXPECT_EQ(keys[0].default_value, "0.5");
  EXPECT_EQ(keys[0].about, "Length of the room's response.");
  EXPECT_EQ(allowed_text(keys[0]), "above 0 and at most 0.7, or auto");
  EXPECT_EQ(unit_of_key(keys[0].name), "s");
  EXPECT_EQ(keys[2].name, "place");
  EXPECT_EQ(keys[2].type, KeyType::section);
  EXPECT_EQ(keys[3].name, "place.height_m");
  EXPECT_EQ(keys[3].default_value, "[1, 2]");
  EXPECT_EQ(allowed_text(keys[3]), "least and largest, 0 to 3");
  EXPECT_EQ(keys[4].default_value, std::nullopt);
  EXPECT_TRUE(keys[5].is_required);
  EXPECT_EQ(keys_of(Room{.length_s = 0})[0].default_value, "auto");
}

TEST(ConfigReader, ACheckerRefusesWhatTheReaderWould) {
  EXPECT_EQ(message_of([] { check_values(Room{}, "room"); }), "no InputError");
  EXPECT_EQ(message_of([] { check_values(Room{.rays = 0}, "room"); }),
            "config: room.rays is 0; use a whole number from 1 to 1,048,576: each carries energy");
  EXPECT_THAT(message_of([] { check_values(Room{.length_s = NAN}, ""); }), HasSubstr("config: length_s is nan; use a number"));
  EXPECT_THAT(message_of([] { check_values(Room{.height_m = {1, 4}}, "room"); }), HasSubstr("room.place.height_m is [1, 4]"));
}

TEST(ConfigReader, MapsOfFreeKeysAndListsOfMapsAreDescribedByAPlaceholder) {
  const auto read_all = [](ConfigReader& reader) {
    ConfigReader assign = reader.child("assign", kAbout);
    std::vector<std::string> names;
    for (const std::string& name : assign.free_keys("PATTERN")) {
      assign.read(name, names.emplace_back(), kAbout);
    }
    int size = 0;
    for (ConfigReader& item : reader.children("items", kAbout)) {
      item.read("size", size, Allowed::at_least(0), kAbout);
      item.finish();
    }
    reader.refuse({"hidden"}, "has no effect");
    reader.read("hidden", size, kAbout);
    reader.finish();
    return names;
  };
  ConfigReader describer = ConfigReader::describer();
  read_all(describer);
  std::vector<std::string> names;
  for (const ConfigKey& key : describer.described()) names.push_back(key.name);
  EXPECT_THAT(names, testing::ElementsAre("assign", "assign.PATTERN", "items[]", "items[].size"));

  ConfigReader reader = ConfigReader::from_text("assign: {b: x, a: y}\nitems: [{size: 1}, {}]\n", "s.yaml");
  EXPECT_THAT(read_all(reader), testing::ElementsAre("x", "y"));
  const auto refused = [&](const std::string& yaml) {
    return message_of([&] {
      ConfigReader wrong = ConfigReader::from_text(yaml, "s.yaml");
      read_all(wrong);
    });
  };
  EXPECT_THAT(refused("items:\n  - {size: 1}\n  - {size: -1}\n"), HasSubstr("s.yaml:3: items[1].size is -1; use a whole number from 0"));
  EXPECT_THAT(refused("items: {size: 1}\n"), HasSubstr("items: must be a list of maps"));
  EXPECT_THAT(refused("items: [3]\n"), HasSubstr("items[0]: is not a map"));
  EXPECT_THAT(refused("hidden: 3\n"), HasSubstr("s.yaml:1: hidden: has no effect"));
}

TEST(NearestWord, FindsTyposOnly) {
  EXPECT_EQ(nearest_word("enviroment", {"environment", "engine"}), "environment");
  EXPECT_EQ(nearest_word("xyz", {"environment", "engine"}), "");
}

}  // namespace
}  // namespace earshot
