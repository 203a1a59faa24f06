// SPDX-License-Identifier: Apache-2.0
// Corpora of responses: what is drawn, what the labels say, and what is written.

#include "datasets/rir_corpus.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "datasets/rir_corpus_room.h"
#include "sim/base/errors.h"
#include "sim/base/text/json.h"
#include "tests/support/envs/env_cases.h"
#include "tests/support/envs/rir_corpus_cases.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using corpus_cases::lines_of;
using corpus_cases::read_float_wav;
using corpus_cases::tiny;
using corpus_cases::tree;
using testing::HasSubstr;

RirCorpusConfig from_yaml(const std::string& yaml) {
  const TestFolder folder("corpus_yaml");
  write_text(folder.path() / "rir.yaml", yaml);
  return load_rir_corpus_config((folder.path() / "rir.yaml").string(), {});
}

TEST(RirCorpus, RoomsLieInTheirRangesAndDoNotDependOnTheirNumber) {
  RirCorpusConfig config = tiny();
  config.shoeboxes.count = 40;
  config.shoeboxes.floor = {"carpet_heavy", "concrete_smooth"};
  const std::vector<CorpusRoomSpec> rooms = list_corpus_rooms(config);
  ASSERT_EQ(rooms.size(), 40u);
  double least = 1, most = 0;
  for (const CorpusRoomSpec& room : rooms) {
    double x = 0, y = 0, z = 0, a = 0, b = 0;
    char floor[64] = {};
    ASSERT_EQ(std::sscanf(room.scene.c_str(), "shoebox:%lfx%lfx%lf@%lf,%lf,%63[a-z_],", &x, &y, &z, &a, &b, floor), 6) << room.scene;
    for (const double side : {x, z}) EXPECT_TRUE(side >= 3 && side <= 5) << room.scene;
    EXPECT_TRUE(y >= 2.4 - 1e-6 && y <= 3) << room.scene;
    EXPECT_THAT(std::string(floor), testing::AnyOf("carpet_heavy", "concrete_smooth"));
    for (const double wall : {a, b}) least = std::min(least, wall), most = std::max(most, wall);
  }
  EXPECT_TRUE(least >= 0.05 && least < 0.07 && most <= 0.5 && most > 0.4) << least << " " << most;
  config.shoeboxes.count = 7;
  for (std::size_t i = 0; i < 7; ++i) EXPECT_EQ(list_corpus_rooms(config)[i].scene, rooms[i].scene);
  config.seed = 6;
  EXPECT_NE(list_corpus_rooms(config)[0].scene, rooms[0].scene);
}

TEST(RirCorpus, PlacesKeepTheirDistances) {
  RirCorpusConfig config = tiny();
  config.min_distance_m = 1.5f;
  config.max_distance_m = 2.5f;
  config.source_height_m = {1.f, 1.2f};
  config.listener_height_m = {1.5f, 1.6f};
  config.pitch_deg = {-10, 20};
  const CorpusRoom room(config, 1, list_corpus_rooms(config)[1]);
  const Bounds& bounds = room.scene().bounds();
  for (int s = 0; s < 5; ++s) {
    const CorpusSource source = room.draw_source(s);
    EXPECT_TRUE(source.sound.position.y >= 1.f - 0.06f && source.sound.position.y <= 1.2f + 0.06f) << source.sound.position.y;
    for (int l = 0; l < 20; ++l) {
      const CorpusListener listener = room.draw_listener(source, s, l);
      const float distance_m = glm::length(listener.position - source.sound.position);
      EXPECT_TRUE(distance_m >= 1.5f && distance_m <= 2.5f) << distance_m;
      EXPECT_TRUE(listener.pitch_deg >= -10 && listener.pitch_deg <= 20) << listener.pitch_deg;
      for (const int axis : {0, 2}) {  // the floor's edge is found to a cell of 5 cm
        EXPECT_GE(listener.position[axis], bounds.lower[axis] + 0.2f);
        EXPECT_LE(listener.position[axis], bounds.upper[axis] - 0.2f);
      }
    }
  }
}

// By hand, from the positions that the manifest states.
TEST(RirCorpus, LabelsAreThoseOfThePlaces) {
  RirCorpusConfig config = tiny();
  config.channels = "mono";
  config.acoustics.sh_order = 0;
  const TestFolder folder("corpus_labels");
  const CorpusReport report = write_rir_corpus(config, {.out = folder.path(), .threads = 2, .shard = {}, .progress = {}});
  EXPECT_EQ(report.responses, 18u);
  EXPECT_EQ(report.folders_missing, 0u);
  const auto lines = lines_of(folder.path() / "manifest.jsonl");
  ASSERT_EQ(lines.size(), 18u);
  for (const auto& line : lines) {
    const auto from = line["source"]["position_m"], at = line["listener"]["position_m"];
    const double x = from[0].get<double>() - at[0].get<double>(), y = from[1].get<double>() - at[1].get<double>(),
                 z = from[2].get<double>() - at[2].get<double>();
    const double distance_m = std::sqrt(x * x + y * y + z * z);
    EXPECT_NEAR(line["distance_m"].get<double>(), distance_m, 1e-4);
    EXPECT_NEAR(line["direct_delay_s"].get<double>(), distance_m / 343.2, 1e-6);
    EXPECT_TRUE(line["line_of_sight"].get<bool>());  // nothing stands in an empty room
    // Facing -z at heading 0, counter-clockwise: azimuth of the source in the world less the heading.
    const double degree = std::numbers::pi / 180;
    const double azimuth = std::atan2(-x, -z) / degree - line["listener"]["heading_deg"].get<double>();
    EXPECT_NEAR(std::remainder(line["azimuth_deg"].get<double>() - azimuth, 360.0), 0, 1e-2) << line;
    EXPECT_NEAR(line["elevation_deg"].get<double>(), std::asin(y / distance_m) / degree, 1e-2);
    const auto wav = read_float_wav(read_file(folder.path() / line["file"].get<std::string>()));
    EXPECT_EQ(wav.rate_hz, 16000);
    ASSERT_EQ(wav.channels.size(), 1u);
    ASSERT_EQ(wav.channels[0].size(), line["num_samples"].get<std::size_t>());
    // Sound is there when the line brings it: the first sample above a tenth of the peak, within the width of the impulse.
    float peak = 0;
    for (const float sample : wav.channels[0]) peak = std::max(peak, std::abs(sample));
    const auto first = std::ranges::find_if(wav.channels[0], [&](float sample) { return std::abs(sample) > 0.1f * peak; });
    EXPECT_NEAR(static_cast<double>(first - wav.channels[0].begin()), 16000 * distance_m / 343.2, 8) << line;
  }
}

TEST(RirCorpus, SplitPartsAddUpToTheWhole) {
  RirCorpusConfig config = tiny();
  config.shoeboxes.count = 1;
  config.split_ms = 20;
  const TestFolder folder("corpus_split");
  write_rir_corpus(config, {.out = folder.path(), .threads = 1, .shard = {}, .progress = {}});
  for (const auto& line : lines_of(folder.path() / "manifest.jsonl")) {
    const auto read = [&](const char* key) { return read_float_wav(read_file(folder.path() / line[key].get<std::string>())).channels; };
    const auto whole = read("file"), early = read("early_file"), late = read("late_file");
    const auto split = line["split_sample"].get<std::size_t>();
    EXPECT_NEAR(static_cast<double>(split), 16000 * (line["direct_delay_s"].get<double>() + 0.02), 1);
    ASSERT_EQ(whole.size(), 2u);
    for (std::size_t channel = 0; channel < 2; ++channel)
      for (std::size_t i = 0; i < whole[channel].size(); ++i) {
        ASSERT_EQ(early[channel][i], i < split ? whole[channel][i] : 0.f);
        ASSERT_EQ(late[channel][i], i < split ? 0.f : whole[channel][i]);
      }
  }
}

TEST(RirCorpus, FlacHoldsTheSameSoundTo24Bits) {
  RirCorpusConfig config = tiny();
  config.shoeboxes.count = 1;
  config.channels = "mono";
  const TestFolder wav("corpus_wav"), flac("corpus_flac");
  write_rir_corpus(config, {.out = wav.path(), .threads = 1, .shard = {}, .progress = {}});
  config.format = SoundFormat::flac;
  write_rir_corpus(config, {.out = flac.path(), .threads = 1, .shard = {}, .progress = {}});
  const auto expected = lines_of(wav.path() / "manifest.jsonl"), lines = lines_of(flac.path() / "manifest.jsonl");
  ASSERT_EQ(lines.size(), 6u);
  for (std::size_t i = 0; i < lines.size(); ++i) {
    const auto exact = read_float_wav(read_file(wav.path() / expected[i]["file"].get<std::string>())).channels.at(0);
    const SoundClip clip = load_sound(flac.path() / lines[i]["file"].get<std::string>(), 16000);
    const float gain = lines[i]["gain"].get<float>();
    ASSERT_EQ(clip.samples.size(), exact.size());
    for (std::size_t n = 0; n < exact.size(); ++n) ASSERT_NEAR(clip.samples[n], exact[n] * gain, 0x1p-23) << n;
  }
}

TEST(RirCorpus, FieldsReachTheErrorThatIsAsked) {
  RirCorpusConfig config = tiny();
  config.shoeboxes.count = 2;
  config.acoustics.field = Switch::on;
  config.acoustics.field_error = 0.05f;
  config.acoustics.rir_length_s = 0.4f;
  const TestFolder folder("corpus_field");
  write_rir_corpus(config, {.out = folder.path(), .threads = 2, .shard = {}, .progress = {}});
  for (const auto& line : lines_of(folder.path() / "manifest.jsonl")) {
    ASSERT_TRUE(line["field_t20_error"].is_number()) << line;
    EXPECT_GT(line["field_t20_error"].get<double>(), 0);
    EXPECT_LE(line["field_t20_error"].get<double>(), 0.07);  // with the blur of cells beside the photons' 0.05
  }
}

TEST(RirCorpus, RandomMaterialsDifferFromRoomToRoom) {
  RirCorpusConfig config = tiny();
  config.shoeboxes.count = 0;
  config.scenes = {"shoebox:4x3x4@0.2"};
  config.rooms_per_scene = 3;
  config.randomize.emplace();
  const std::vector<CorpusRoomSpec> rooms = list_corpus_rooms(config);
  ASSERT_EQ(rooms.size(), 3u);
  const CorpusRoom first(config, 0, rooms[0]), second(config, 1, rooms[1]), again(config, 0, rooms[0]);
  EXPECT_NE(first.scene().hash(), second.scene().hash());
  EXPECT_EQ(first.scene().hash(), again.scene().hash());
}

TEST(RirCorpus, WhatWasBegunOtherwiseIsRefused) {
  RirCorpusConfig config = tiny();
  config.shoeboxes.count = 1;
  const TestFolder folder("corpus_other");
  const CorpusRun run{.out = folder.path(), .threads = 1, .shard = {}, .progress = {}};
  write_rir_corpus(config, run);
  const auto before = tree(folder.path());
  EXPECT_EQ(write_rir_corpus(config, run).responses, 0u);  // nothing is left to do
  config.min_distance_m = 0.75f;
  EXPECT_THAT(message_of<InputError>([&] { write_rir_corpus(config, run); }),
              HasSubstr("'min_distance_m: 0.5' there, 'min_distance_m: 0.75'"));
  EXPECT_EQ(tree(folder.path()), before);
}

TEST(RirCorpus, ConfigsAreCheckedByKey) {
  const auto refused = [](const std::string& yaml) { return message_of<InputError>([&] { from_yaml(yaml); }); };
  const std::string room = "shoeboxes: {count: 1}\n";
  EXPECT_THAT(refused("seed: 1\n"), HasSubstr("give no room"));
  EXPECT_THAT(refused(room + "sorces_per_room: 2\n"), HasSubstr("did you mean 'sources_per_room'"));
  EXPECT_THAT(refused("shoeboxes: {count: 1, max_size_m: [2, 2, 2]}\n"), HasSubstr("shoeboxes.max_size_m"));
  EXPECT_THAT(refused("shoeboxes: {count: 1, absorption: [0.5, 0.1]}\n"), HasSubstr("shoeboxes.absorption"));
  EXPECT_THAT(refused(room + "clearance_m: 0\n"), HasSubstr("clearance_m"));
  EXPECT_THAT(refused(room + "source_patterns: [cardiod]\n"), HasSubstr("cardiod"));
  EXPECT_THAT(refused(room + "channels: mono\nhrtf: head.sofa\n"), HasSubstr("has no effect with channels 'mono'"));
  EXPECT_THAT(refused(room + "channels: ambisonic:3\nformat: flac\n"), HasSubstr("8 channels"));
  EXPECT_THAT(refused(room + "split_ms: 2000\n"), HasSubstr("split_ms"));
  EXPECT_THAT(refused(room + "sofa: true\nsplit_ms: 20\n"), HasSubstr("split_ms"));
  EXPECT_THAT(refused(room + "hrtf: a.sofa\nhrtfs: [b.sofa]\n"), HasSubstr("are both set"));
  EXPECT_THAT(refused(room + "panorama: {width_px: 100, height_px: 60}\n"), HasSubstr("at most half as high"));
  EXPECT_THAT(refused(room + "acoustics: {threads: 4}\n"), HasSubstr("--threads"));
  EXPECT_THAT(refused(room + "acoustics: {rir_length_s: 0}\n"), HasSubstr("rir_length_s"));
  EXPECT_THAT(refused(room + "randomize: {seed: 3}\n"), HasSubstr("seed"));
  EXPECT_THAT(message_of<InputError>([] { CorpusShard::parse("0/2"); }), HasSubstr("K from 1 to N"));
  EXPECT_THAT(message_of<InputError>([] { CorpusShard::parse("1"); }), HasSubstr("K/N"));
}

// What corpus.json states is the corpus: read back, it gives the same config.
TEST(RirCorpus, TheStatedConfigIsTheConfig) {
  RirCorpusConfig config = tiny();
  config.channels = "ambisonic:2";
  config.randomize.emplace().noise_std = 0.07f;
  config.scenes = {"house:1"};
  const std::string text = config_text(config);
  EXPECT_EQ(config_text(from_yaml(text)), text);
  EXPECT_THAT(text, HasSubstr("noise_std: 0.07"));
}

// What mixtures need: every source of a room at the same listeners, each as far as the config asks.
TEST(RirCorpus, SharedListenersAreThoseOfAllSources) {
  RirCorpusConfig config = tiny();
  config.shared_listeners = true;
  config.min_distance_m = 1;
  config.sources_per_room = 3;
  const CorpusRoom room(config, 0, list_corpus_rooms(config)[0]);
  for (int listener = 0; listener < 10; ++listener) {
    const CorpusListener first = room.draw_listener(room.draw_source(0), 0, listener);
    for (int source = 0; source < 3; ++source) {
      const CorpusSource from = room.draw_source(source);
      const CorpusListener again = room.draw_listener(from, source, listener);
      EXPECT_EQ(again.position, first.position);
      EXPECT_EQ(again.heading_deg, first.heading_deg);
      EXPECT_GE(glm::length(again.position - from.sound.position), 1.f);
    }
  }
}

// Without HDF5: what the writer is handed.
TEST(RirCorpus, SofaFilesOfHarmonicsStateTheirLevel) {
  RirCorpusConfig config = tiny();
  config.shoeboxes.count = 1;
  config.sources_per_room = config.listeners_per_source = 1;
  config.sofa = true;
  for (const std::string channels : {"mono", "ambisonic:1"}) {
    config.channels = channels;
    const TestFolder folder("corpus_sofa_comment");
    std::string comment;
    const auto encode = [&](const SofaRoomResponses& responses, const std::string&) {
      comment = responses.comment;
      return std::string("sofa");
    };
    write_rir_corpus(config, {.out = folder.path(), .threads = 1, .shard = {}, .progress = {}, .encode_sofa = encode});
    EXPECT_THAT(comment, HasSubstr("pressure of a source of 1/(4 pi r) at 1 m"));
    EXPECT_EQ(comment.find("by ACN") != std::string::npos, channels != "mono") << comment;
  }
}

TEST(RirCorpus, HeadsAreDrawnPerListener) {
  RirCorpusConfig config = tiny();
  config.shoeboxes.count = 1;
  const TestFolder one_head("corpus_head"), several_heads("corpus_heads");
  write_rir_corpus(config, {.out = one_head.path(), .threads = 1, .shard = {}, .progress = {}});
  config.hrtfs = {"sphere", "sphere"};  // two of the same: the draw shows, and no response changes
  config.listeners_per_source = 12;
  write_rir_corpus(config, {.out = several_heads.path(), .threads = 2, .shard = {}, .progress = {}});
  const CorpusRoom room(config, 0, list_corpus_rooms(config)[0]);
  int first_head = 0;
  for (int listener = 0; listener < 12; ++listener) first_head += room.draw_listener(room.draw_source(0), 0, listener).head == 0;
  EXPECT_TRUE(first_head > 1 && first_head < 11) << first_head;
  EXPECT_EQ(lines_of(several_heads.path() / "manifest.jsonl").at(3)["listener"]["hrtf"], "sphere");
  EXPECT_TRUE(read_file(one_head.path() / "00000/000000_s01_l0002.wav") == read_file(several_heads.path() / "00000/000000_s01_l0002.wav"));
}

TEST(RirCorpus, ChannelsHaveNames) {
  RirCorpusConfig config = tiny();
  config.shoeboxes.count = 1;
  config.sources_per_room = config.listeners_per_source = 1;
  config.channels = "ambisonic:1";
  const TestFolder folder("corpus_names");
  write_rir_corpus(config, {.out = folder.path(), .threads = 1, .shard = {}, .progress = {}});
  const auto corpus = parse_json(read_file(folder.path() / "corpus.json"));
  EXPECT_EQ(corpus["channels"], nlohmann::json({"acn0", "acn1", "acn2", "acn3"}));
  const auto recordings = lines_of(folder.path() / "recordings.jsonl");
  ASSERT_EQ(recordings.size(), 1u);
  EXPECT_EQ(recordings[0]["sources"][0]["channels"], nlohmann::json({0, 1, 2, 3}));
  EXPECT_EQ(recordings[0]["num_samples"], 1600);
  EXPECT_EQ(recordings[0]["duration"], 0.1);
  EXPECT_EQ(read_float_wav(read_file(folder.path() / recordings[0]["sources"][0]["source"].get<std::string>())).channels.size(), 4u);
}

}  // namespace
}  // namespace earshot
