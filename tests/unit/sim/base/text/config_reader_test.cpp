#include "sim/base/text/config_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sim/base/random.h"

namespace earshot {
namespace {

using testing::HasSubstr;

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
  reader.read("lr", lr);
  reader.read("other", other);
  reader.read("name", name);
  ConfigReader child = reader.child("child");
  int n = 0;
  child.read("n", n);
  child.finish();
  reader.finish();
  EXPECT_EQ(lr, 0.5);
  EXPECT_EQ(other, 7);
  EXPECT_EQ(name, "x");
  EXPECT_EQ(n, 3);
}

TEST(ConfigReader, UnknownKeyNamesTheNearest) {
  ConfigReader reader = ConfigReader::from_text("ppo: {learning_rat: 1}", "run.yaml");
  ConfigReader ppo = reader.child("ppo");
  double rate = 0;
  ppo.read("learning_rate", rate);
  const auto message = message_of([&] { ppo.finish(); });
  EXPECT_THAT(message, HasSubstr("run.yaml"));
  EXPECT_THAT(message, HasSubstr("ppo.learning_rat"));
  EXPECT_THAT(message, HasSubstr("did you mean 'learning_rate'"));
}

TEST(ConfigReader, WrongTypesAndChoicesAreNamed) {
  ConfigReader reader = ConfigReader::from_text("a: word\nb: 1.5\nc: up", "test");
  int number = 0;
  EXPECT_THAT(message_of([&] { reader.read("a", number); }), HasSubstr("a: 'word' cannot be read as a whole number"));
  EXPECT_THAT(message_of([&] { reader.read("b", number); }), HasSubstr("b: '1.5'"));
  EXPECT_THAT(message_of([&] { reader.read_choice<int>("c", number, {{"x", 0}, {"y", 1}}); }), HasSubstr("none of: x, y"));
  EXPECT_THAT(message_of([&] { reader.read_required("missing", number); }), HasSubstr("missing: is missing"));
  EXPECT_THAT(message_of([&] { (void)reader.child("a"); }), HasSubstr("must be a map"));
}

TEST(ConfigReader, OverridesReplaceAndCreate) {
  ConfigReader reader = ConfigReader::from_text("ppo: {lr: 1}\nn: 2", "test", {"ppo.lr=0.25", "new.deep.key=[1, 2]", "n=5"});
  ConfigReader ppo = reader.child("ppo");
  double lr = 0;
  ppo.read("lr", lr);
  EXPECT_EQ(lr, 0.25);
  ConfigReader fresh = reader.child("new");
  ConfigReader deep = fresh.child("deep");
  std::vector<int> list;
  deep.read("key", list);
  EXPECT_EQ(list, (std::vector<int>{1, 2}));
  int n = 0;
  reader.read("n", n);
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
    reader.read("n", value);
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
  for (const std::string escape : {"\\N", "\\_"}) {
    EXPECT_THAT(message_of([&] { ConfigReader::from_text("n: \"a" + escape + "\"\n", "run.yaml"); }), HasSubstr("cannot be written"))
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
      ConfigReader air = reader.child("air");
      double temperature = 0;
      air.read("temperature_c", temperature);
      air.finish();
      std::string mesh;
      reader.read("mesh", mesh);
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
  recorder.read("rays", rays);
  recorder.read("name", name);
  recorder.read_choice<bool>("switch", on, {{"off", false}, {"on", true}});
  ConfigReader child = recorder.child("sound");
  child.read("gain", gain);
  child.finish();
  recorder.finish();
  EXPECT_EQ(rays, 7);

  rays = 0, gain = 0, name = "", on = false;
  ConfigReader reader = ConfigReader::from_text(recorder.effective(), "recorded");
  reader.read_required("rays", rays);
  reader.read_required("name", name);
  reader.read_choice<bool>("switch", on, {{"off", false}, {"on", true}});
  ConfigReader sound = reader.child("sound");
  sound.read_required("gain", gain);
  EXPECT_EQ(rays, 7);
  EXPECT_EQ(gain, 0.1f);
  EXPECT_EQ(name, "auto: yes");
  EXPECT_TRUE(on);
}

TEST(NearestWord, FindsTyposOnly) {
  EXPECT_EQ(nearest_word("enviroment", {"environment", "engine"}), "environment");
  EXPECT_EQ(nearest_word("xyz", {"environment", "engine"}), "");
}

}  // namespace
}  // namespace earshot
