// SPDX-License-Identifier: Apache-2.0
// Sound files and texts as users have them: what is bad is named before anything is written, and nothing is lost without a word.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "tests/support/programs/dataset_cli.h"

namespace earshot {
namespace {

using corpus_cases::differences;
using corpus_cases::tree;
using testing::HasSubstr;

class DatasetInputsCli : public DatasetCli {
 protected:
  DatasetInputsCli() : DatasetCli("dataset_inputs_cli") {
    speak("a.wav", 1, 900);
    speak("b.wav", 2, 1500);
  }
  /// Text by speech file, of all talkers of a corpus.
  [[nodiscard]] std::map<std::string, std::string> texts(const std::string& out) const {
    std::map<std::string, std::string> all;
    for (const auto& line : lines(out + "/manifest.jsonl"))
      for (const auto& talker : line["talkers"]) all[talker["speech"]] = talker.contains("text") ? talker["text"].get<std::string>() : "-";
    return all;
  }
};

// A further talker longer than the first keeps its end, and the recording holds all of it.
TEST_F(DatasetInputsCli, LongerTalkersAreHeardToTheirEnd) {
  const std::map<std::string, std::size_t> lengths{{"a.wav", 900}, {"b.wav", 1500}, {"c.wav", 4000}, {"d.wav", 60}};
  speak("c.wav", 3, 4000);
  speak("d.wav", 4, 60);
  for (const std::string cut : {"", "--cut"}) {
    const std::string out = "out" + cut;
    const Outcome made = convolve(out, "--talkers 2,3 --stems --count 12 " + cut);
    ASSERT_EQ(made.exit_code, 0) << made.text;
    std::size_t longer = 0;
    for (const auto& line : lines(out + "/manifest.jsonl")) {
      const auto frames = line["num_samples"].get<std::size_t>();
      ASSERT_EQ(sound(out, line["file"]).size(), frames);
      std::size_t expected = 0;
      for (const auto& talker : line["talkers"]) {
        const std::size_t samples = lengths.at(talker["speech"].get<std::string>()), start = talker["start_sample"].get<std::size_t>();
        EXPECT_EQ(talker["num_samples"], samples);
        const auto delay = static_cast<std::size_t>(std::lround(kRateHz * talker["direct_delay_s"].get<double>()));
        expected = std::max(expected, start + samples + delay);
        if (cut.empty()) expected = std::max(expected, start + samples + 400 - 1);  // 0.05 s of response
        longer += samples > line["talkers"][0]["num_samples"].get<std::size_t>();
        // Its last samples sound: the direct sound of noise has no pause.
        EXPECT_GT(energy(sound(out, talker["file"]), start + delay + samples - 10), 0) << talker;
      }
      EXPECT_EQ(frames, expected) << line;
    }
    EXPECT_GT(longer, 5u);
    for (const auto& segment : lines(out + "/supervisions.jsonl"))
      EXPECT_NEAR(segment["duration"].get<double>(),
                  static_cast<double>(lengths.at(segment["custom"]["speech"].get<std::string>())) / kRateHz, 1e-12);
  }
}

TEST_F(DatasetInputsCli, ShortClipsHaveSupervisionsOfTheirLength) {
  std::filesystem::remove(path("speech/a.wav"));
  std::filesystem::remove(path("speech/b.wav"));
  const std::vector<std::size_t> lengths{1, 2, 3, 5, 8, 13, 20, 40, 41, 80};
  for (const std::size_t samples : lengths) speak(fmt::format("{:02}.wav", samples), samples, samples);
  for (const std::string cut : {"", "--cut"}) {
    const std::string out = "short" + cut;
    const Outcome made = convolve(out, cut);
    ASSERT_EQ(made.exit_code, 0) << made.text;
    const auto segments = lines(out + "/supervisions.jsonl"), recordings = lines(out + "/recordings.jsonl");
    ASSERT_EQ(segments.size(), lengths.size());
    for (std::size_t i = 0; i < lengths.size(); ++i) {
      const double duration_s = segments[i]["duration"].get<double>();
      EXPECT_NEAR(duration_s, static_cast<double>(lengths[i]) / kRateHz, 1e-12);
      EXPECT_LE(segments[i]["start"].get<double>() + duration_s, recordings[i]["duration"].get<double>() + 1e-12);
    }
  }
}

TEST_F(DatasetInputsCli, TextsAreCleanAndListsOfLibriSpeechAreRead) {
  const std::map<std::string, std::string> beside{
      {"crlf", "one\r\ntwo\r\n"}, {"mark", "\xEF\xBB\xBFwords of mark"}, {"both", "\xEF\xBB\xBFone\r\ntwo\r\n\r\n"},
      {"cr", "one\rtwo\r"},       {"blank", " \t words \r\n"},           {"empty", "\xEF\xBB\xBF\r\n"},
      {"plain", "caf\xC3\xA9"}};
  std::uint64_t seed = 10;
  for (const auto& [name, text] : beside) {
    speak(name + ".wav", ++seed, 200);
    write_text(path("speech/" + name + ".txt"), text);
  }
  speak("upper.wav", ++seed, 200);
  write_text(path("speech/upper.TXT"), "IN CAPITALS\r\n");
  for (const char* name : {"84/121123/84-121123-0000.wav", "84/121123/84-121123-0001.wav", "84/121123/84-121123-0002.wav",
                           "84/121550/84-121550-0000.wav", "84/121550/84-121550-0001.wav"})
    speak(name, ++seed, 200);
  write_text(path("speech/84/121123/84-121123.trans.txt"), "84-121123-0000 GO DO YOU HEAR\n84-121123-0001 BUT IN LESS\n84-121123-0002\n");
  write_text(path("speech/84/121550/84-121550.trans.txt"),
             "\xEF\xBB\xBF"
             "84-121550-0000\tHE WAS\r\n\r\n84-121550-0001  TWO BLANKS \r\n84-121550-0007 NOBODY SAYS THIS\r\n");
  write_text(path("speech/84/121550/84-121550-0001.txt"), "its own text");
  const Outcome made = convolve("out");
  ASSERT_EQ(made.exit_code, 0) << made.text;
  EXPECT_EQ(texts("out"), (std::map<std::string, std::string>{{"a.wav", "-"},
                                                              {"b.wav", "-"},
                                                              {"crlf.wav", "one\ntwo"},
                                                              {"mark.wav", "words of mark"},
                                                              {"both.wav", "one\ntwo"},
                                                              {"cr.wav", "one\ntwo"},
                                                              {"blank.wav", "words"},
                                                              {"empty.wav", ""},
                                                              {"plain.wav", "caf\xC3\xA9"},
                                                              {"upper.wav", "IN CAPITALS"},
                                                              {"84/121123/84-121123-0000.wav", "GO DO YOU HEAR"},
                                                              {"84/121123/84-121123-0001.wav", "BUT IN LESS"},
                                                              {"84/121123/84-121123-0002.wav", ""},
                                                              {"84/121550/84-121550-0000.wav", "HE WAS"},
                                                              {"84/121550/84-121550-0001.wav", "its own text"}}));
  EXPECT_THAT(made.text, HasSubstr("2 of 15 speech files have no text"));
  EXPECT_THAT(made.text, HasSubstr("1 lines of *.trans.txt name no sound file"));
  for (const auto& segment : lines("out/supervisions.jsonl"))
    EXPECT_EQ(segment.contains("text") ? segment["text"].get<std::string>() : "-", texts("out").at(segment["custom"]["speech"]));
  write_text(path("speech/84/121123/84-121123.trans.txt"), "84-121123-0000 GO\n84-121123-0000 STAY\n");
  expect_refused(convolve("refused"), "84-121123.trans.txt:2: has a second text for 84-121123-0000", "refused");
  // Lines are counted as an editor counts them, blank ones at the begin among them.
  write_text(path("speech/84/121123/84-121123.trans.txt"), "\xEF\xBB\xBF\r\n\n84-121123-0000 GO\r\n\n84-121123-0000 STAY\n");
  expect_refused(convolve("refused"), "84-121123.trans.txt:5: has a second text for 84-121123-0000", "refused");
  write_text(path("speech/84/121123/84-121123.trans.txt"), "84-121123-0000 caf\xE9\n");
  expect_refused(convolve("refused"), "84-121123.trans.txt: is not UTF-8 text", "refused");
}

// Kinds of bad files, by what a message says of them.
TEST_F(DatasetInputsCli, BadFilesAreNamedFirstOrLeftOutByARecord) {
  ASSERT_EQ(convolve("good").exit_code, 0);
  const std::string whole = read_file(path("speech/a.wav"));
  std::vector<float> opposite = noise_of(5, 400);
  for (const float sample : noise_of(5, 400)) opposite.push_back(-sample);
  const std::map<std::string, std::function<void(const std::string&)>> kinds{
      {"empty.wav", [](const std::string& file) { write_text(file, ""); }},
      {"header.wav", [&](const std::string& file) { write_text(file, whole.substr(0, 44)); }},
      {"half.wav", [&](const std::string& file) { write_text(file, whole.substr(0, whole.size() / 2)); }},
      {"page.flac", [](const std::string& file) { write_text(file, "<html>404</html>"); }},
      {"._a.wav", [](const std::string& file) { write_text(file, std::string("\0\5\x16\7\0\2\0\0Mac OS X", 16)); }},
      {"silent.wav", [](const std::string& file) { write_wav(file, std::vector<float>(2000, 0.f), 1, 8000); }},
      {"opposite.wav", [&](const std::string& file) { write_wav(file, opposite, 2, 8000); }},
      {"rate.wav", [](const std::string& file) { write_wav(file, noise_of(6, 400), 1, 900); }},
      {"caf\xE9.wav", [](const std::string& file) { write_wav(file, noise_of(7, 400), 1, 8000); }},
      {"latin.wav",
       [](const std::string& file) {
         write_wav(file, noise_of(8, 400), 1, 8000);
         write_text(std::filesystem::path(file).replace_extension(".txt"), "caf\xE9");
       }},
      {"utf16.wav",
       [](const std::string& file) {
         write_wav(file, noise_of(9, 400), 1, 8000);
         write_text(std::filesystem::path(file).replace_extension(".txt"), std::string("\xFF\xFEo\0n\0e\0", 8));
       }},
      {"dangling.wav", [](const std::string& file) { std::filesystem::create_symlink("nowhere.wav", file); }},
      {"lost.wav",
       [](const std::string& file) {
         write_wav(file, noise_of(9, 400), 1, 8000);
         std::filesystem::create_symlink("nowhere.txt", std::filesystem::path(file).replace_extension(".txt"));
       }},
      {"long.wav", [](const std::string& file) {
         write_wav(file, noise_of(9, 400), 1, 8000);
         write_text(std::filesystem::path(file).replace_extension(".txt"), std::string(70000, 'a'));
       }}};
  for (const auto& [name, write] : kinds) {
    write(path("speech/" + name));
    const std::string shown = name.substr(0, std::min(name.rfind('.'), name.find('\xE9')));  // the sound or its text
    expect_refused(convolve("refused"), "1 bad input file: " + path("speech/" + shown), "refused");
    for (const char* ending : {"", ".txt"}) {
      std::filesystem::path file = path("speech/" + name);
      std::filesystem::remove(*ending ? file.replace_extension(ending) : file);
    }
  }
  for (const auto& [name, write] : kinds) write(path("speech/" + name));
  ASSERT_TRUE(std::filesystem::is_symlink(path("speech/dangling.wav")));
  const Outcome all = convolve("refused");
  expect_refused(all, "14 bad input files: ", "refused");
  EXPECT_THAT(all.text, HasSubstr("4 more"));

  // Left out, with a record; the corpus is that of the good files but for what corpus.json says.
  const Outcome first = convolve("skipped", "--skip-bad --signals-per-folder 1 --shard 1/2");
  ASSERT_EQ(first.exit_code, 0) << first.text;
  EXPECT_THAT(first.text, HasSubstr("14 bad sound files are left out"));
  const std::string record = read_file(path("skipped/inputs.jsonl"));
  std::set<std::string> left_out, used;
  for (const auto& line : lines("skipped/inputs.jsonl")) {
    EXPECT_EQ(line["group"], "speech");
    (line["left_out"].is_null() ? used : left_out).insert(line["file"]);
    EXPECT_THAT(line["left_out"].dump(), testing::Not(HasSubstr(folder_.path().string())));
  }
  EXPECT_EQ(used, (std::set<std::string>{"a.wav", "b.wav"}));
  EXPECT_EQ(left_out.size(), kinds.size());
  // With the bad files removed the second shard completes the corpus, and the record stays as it is.
  for (const auto& [name, write] : kinds) std::filesystem::remove(path("speech/" + name));
  const Outcome second = convolve("skipped", "--skip-bad --signals-per-folder 1 --shard 2/2");
  ASSERT_EQ(second.exit_code, 0) << second.text;
  EXPECT_THAT(second.text, HasSubstr("complete, 2 signals"));
  EXPECT_EQ(read_file(path("skipped/inputs.jsonl")), record);
  for (const auto& line : lines("skipped/manifest.jsonl")) EXPECT_TRUE(used.contains(line["talkers"][0]["speech"])) << line;

  std::filesystem::remove(path("speech/a.wav"));
  write_text(path("speech/b.wav"), "no sound");
  expect_refused(convolve("refused", "--skip-bad"), "has no usable sound file", "refused");
}

TEST_F(DatasetInputsCli, NoiseIsOpenedFirstAndAPauseInItIsNotHeard) {
  std::filesystem::create_directory(path("noise"));
  // Nine tenths of a minute are silent: most drawn offsets lie in the pause.
  std::vector<float> door(480000, 0.f);
  const std::vector<float> slam = noise_of(3, 800);
  std::ranges::copy(slam, door.begin() + 200000);
  write_wav(path("noise/door.wav"), door, 1, kRateHz);
  const std::string noise = "--stems --count 10 --snr 10,10 --noise " + path("noise");
  for (const std::string talkers : {"1", "3"}) {  // the noise from a source, and in each channel
    const Outcome made = convolve("out" + talkers, noise + " --talkers " + talkers);
    ASSERT_EQ(made.exit_code, 0) << made.text;
    for (const auto& line : lines("out" + talkers + "/manifest.jsonl")) {
      EXPECT_EQ(line["noise"]["response"].is_null(), talkers == "3");
      std::vector<float> speech(line["num_samples"].get<std::size_t>(), 0.f);
      for (const auto& talker : line["talkers"]) {
        const std::vector<float> stem = sound("out" + talkers, talker["file"]);
        for (std::size_t i = 0; i < stem.size(); ++i) speech[i] += stem[i];
      }
      EXPECT_NEAR(10 * std::log10(energy(speech) / energy(sound("out" + talkers, line["noise"]["file"]))), 10, 0.01) << line;
    }
  }
  write_wav(path("noise/silent.wav"), std::vector<float>(3000, 0.f), 1, kRateHz);
  expect_refused(convolve("refused", noise), "silent.wav: is silent", "refused");
  const Outcome skipped = convolve("skipped", noise + " --skip-bad");
  ASSERT_EQ(skipped.exit_code, 0) << skipped.text;
  for (const auto& line : lines("skipped/manifest.jsonl")) EXPECT_EQ(line["noise"]["sound"], "door.wav");
}

// Four channels, each with noise of its own from a file that is mostly a pause: all sound, and no two alike.
TEST_F(DatasetInputsCli, ChannelsHaveNoiseOfTheirOwnAlsoFromAPause) {
  const std::string channels = "--set channels=ambisonic:1:sn3d:ego ";
  ASSERT_EQ(dataset("rir " + path("rir.yaml") + " " + channels + "--out " + path("wide")).exit_code, 0);
  std::filesystem::create_directory(path("noise"));
  std::vector<float> door(480000, 0.f);
  std::ranges::copy(noise_of(3, 400), door.begin() + 200000);
  write_wav(path("noise/door.wav"), door, 1, kRateHz);
  ASSERT_EQ(dataset("convolve " + path("wide") + " --speech " + path("speech") + " --noise " + path("noise") +
                    " --talkers 3 --stems --count 10 --snr 10,10 --out " + path("out"))
                .exit_code,
            0);
  const auto manifest = lines("out/manifest.jsonl");
  ASSERT_EQ(manifest.size(), 10u);
  for (const auto& line : manifest) {
    ASSERT_TRUE(line["noise"]["response"].is_null());
    const auto all = corpus_cases::read_float_wav(read_file(path("out/" + line["noise"]["file"].get<std::string>()))).channels;
    ASSERT_EQ(all.size(), 4u);
    for (std::size_t a = 0; a < all.size(); ++a) {
      ASSERT_GT(energy(all[a]), 0) << line;
      for (std::size_t b = 0; b < a; ++b) {
        double product = 0;
        for (std::size_t i = 0; i < all[a].size(); ++i) product += static_cast<double>(all[a][i]) * static_cast<double>(all[b][i]);
        // White noise of 400 samples and more against itself, shifted: five standard errors; alike it is 1.
        EXPECT_LT(std::abs(product) / std::sqrt(energy(all[a]) * energy(all[b])), 0.25) << line << a << b;
      }
    }
  }
}

// Noise far above the events: no channel is silent where it alone draws a pause.
TEST_F(DatasetInputsCli, ChannelsOfSoundScenesAreJudgedByThemselves) {
  for (const char* folder : {"talk", "noise"}) std::filesystem::create_directory(path(folder));
  write_wav(path("talk/a.wav"), noise_of(5, 4000), 1, kRateHz);
  std::vector<float> door(40000, 0.f);
  std::ranges::copy(noise_of(4, 4000), door.begin() + 9000);
  write_wav(path("noise/door.wav"), door, 1, kRateHz);
  write_text(path("scenes.yaml"),
             "shoeboxes: {count: 1}\nrecordings_per_room: 12\nduration_s: 1\nevent_s: [0.3, 0.5]\nmoving: 0\n"
             "channels: ambisonic:1:sn3d:ego\nsnr_db: [-60, -60]\nclasses: {talk: " +
                 path("talk") + "}\nnoise: " + path("noise") + "\nacoustics: {rays: 16, rir_length_s: 0.05, sample_rate_hz: 8000}\n");
  const Outcome made = dataset("scenes " + path("scenes.yaml") + " --out " + path("made"));
  ASSERT_EQ(made.exit_code, 0) << made.text;
  for (const auto& line : lines("made/manifest.jsonl")) {
    if (line["noise"].is_null()) continue;
    const auto all = corpus_cases::read_float_wav(read_file(path("made/" + line["file"].get<std::string>()))).channels;
    ASSERT_EQ(all.size(), 4u);
    double loudest = 0;
    for (const auto& channel : all) loudest = std::max(loudest, energy(channel));
    // A channel without noise is 50 dB below those with it.
    for (const auto& channel : all) EXPECT_GT(energy(channel), 1e-3 * loudest) << line["id"];
  }
}

// A setting that differs is named at once: a bad file that was added since is not opened before.
TEST_F(DatasetInputsCli, OtherSettingsAreRefusedBeforeFilesAreOpened) {
  std::filesystem::create_directory(path("talk"));
  write_wav(path("talk/a.wav"), noise_of(5, 4000), 1, kRateHz);
  write_text(path("scenes.yaml"),
             "shoeboxes: {count: 1}\nrecordings_per_room: 1\nduration_s: 1\nevent_s: [0.3, 0.5]\nmoving: 0\n"
             "classes: {talk: " +
                 path("talk") + "}\nacoustics: {rays: 16, rir_length_s: 0.05, sample_rate_hz: 8000}\n");
  const auto scenes = [&](const std::string& more) { return dataset("scenes " + path("scenes.yaml") + " --out " + path("made") + more); };
  ASSERT_EQ(convolve("out").exit_code, 0);
  ASSERT_EQ(scenes("").exit_code, 0);
  write_text(path("speech/page.wav"), "<html>404</html>");
  write_text(path("talk/page.wav"), "<html>404</html>");
  for (const auto& [more, key] : std::map<std::string, std::string>{{"--seed 2", "seed"},
                                                                    {"--level -17,-16", "level_dbfs"},
                                                                    {"--count 5", "signals"},
                                                                    {"--noise synth", "noise"},
                                                                    {"--stems", "stems"},
                                                                    {"--skip-bad", "skip_bad"}}) {
    const Outcome refused = convolve("out", more);
    EXPECT_EQ(refused.exit_code, 2);
    EXPECT_THAT(refused.text, HasSubstr("started with other settings: '" + key)) << more;
  }
  const Outcome refused = scenes(" --set duration_s=2");
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.text, HasSubstr("started with other settings: 'duration_s: 1' there, 'duration_s: 2' here"));
  // With the same settings the bad file is what is wrong, and without it the corpus is complete.
  EXPECT_THAT(convolve("out").text, testing::ContainsRegex("1 bad input file: /.*/page.wav: "));
  EXPECT_THAT(scenes("").text, HasSubstr("talk/page.wav: "));
  for (const char* file : {"speech/page.wav", "talk/page.wav"}) std::filesystem::remove(path(file));
  EXPECT_EQ(convolve("out").exit_code, 0);
  EXPECT_EQ(scenes("").exit_code, 0);
}

TEST_F(DatasetInputsCli, AnOutputWithinAnInputIsRefused) {
  std::filesystem::create_directory(path("noise"));
  write_wav(path("noise/n.wav"), noise_of(3, 800), 1, kRateHz);
  std::filesystem::create_directory_symlink(path("speech"), path("link"));
  const auto before = tree(path("speech"));
  expect_refused(convolve("speech/out"), "reads as a whole", "speech/out");
  expect_refused(convolve("speech/deep/../more/out"), "reads as a whole", "speech/more");
  expect_refused(convolve("link/out"), "reads as a whole", "link/out");
  expect_refused(convolve("noise/out", "--noise " + path("noise")), "reads as a whole", "noise/out");
  EXPECT_EQ(differences(before, tree(path("speech"))), std::vector<std::string>{});
  write_text(path("scenes.yaml"), "shoeboxes: {count: 1}\nrecordings_per_room: 1\nduration_s: 1\nevent_s: [0.3, 0.5]\nclasses: {talk: " +
                                      path("speech") + "}\nacoustics: {rays: 16, rir_length_s: 0.05, sample_rate_hz: 8000}\n");
  expect_refused(dataset("scenes " + path("scenes.yaml") + " --out " + path("speech/scenes")), "classes.talk reads as a whole",
                 "speech/scenes");
  expect_refused(dataset("scenes " + path("scenes.yaml") + " --set noise=" + path("noise") + " --out " + path("noise/scenes")),
                 "noise reads as a whole", "noise/scenes");
}

TEST_F(DatasetInputsCli, SoundScenesOpenTheirFilesFirst) {
  // 1.1 s of silence before the sound are longer than an event.
  std::vector<float> late(12000, 0.f);
  std::ranges::copy(noise_of(4, 2000), late.begin() + 9000);
  std::filesystem::create_directory(path("talk"));
  write_wav(path("talk/late.wav"), late, 1, kRateHz);
  write_text(path("scenes.yaml"),
             "shoeboxes: {count: 1}\nrecordings_per_room: 3\nduration_s: 1\nevent_s: [0.3, 0.5]\nmoving: 0\nclasses: {talk: " +
                 path("talk") + "}\nacoustics: {rays: 16, rir_length_s: 0.05, sample_rate_hz: 8000}\n");
  const auto scenes = [&](const std::string& out, const std::string& more = "") {
    return dataset("scenes " + path("scenes.yaml") + " --out " + path(out) + " " + more);
  };
  const Outcome made = scenes("made");
  ASSERT_EQ(made.exit_code, 0) << made.text;
  // Such a sound begins 5 ms before its loudest sample.
  const std::size_t loudest =
      static_cast<std::size_t>(std::ranges::max_element(late, {}, [](float sample) { return std::abs(sample); }) - late.begin());
  std::size_t events = 0;
  for (const auto& line : lines("made/manifest.jsonl")) {
    EXPECT_TRUE(line["level_dbfs"].is_number()) << line;
    for (const auto& event : line["events"]) EXPECT_EQ(event["start_sample"], loudest - kRateHz / 200) << ++events;
  }
  write_text(path("talk/page.wav"), "<html>404</html>");
  expect_refused(scenes("refused"), "talk/page.wav: ", "refused");
  const Outcome skipped = scenes("skipped", "--skip-bad");
  ASSERT_EQ(skipped.exit_code, 0) << skipped.text;
  EXPECT_THAT(skipped.text, HasSubstr("1 bad sound files are left out"));
  EXPECT_EQ(lines("skipped/inputs.jsonl").size(), 2u);
  std::filesystem::remove(path("talk/page.wav"));
  EXPECT_THAT(scenes("skipped", "--skip-bad").text, HasSubstr("complete, 3 recordings"));
  write_text(path("talk/late.wav"), "<html>404</html>");
  expect_refused(scenes("refused", "--skip-bad"), "classes.talk: has no usable sound file", "refused");
}

}  // namespace
}  // namespace earshot
