// SPDX-License-Identifier: Apache-2.0
// Test sets of which only a hash is public.
#include "evaluation/leaderboard/private_set.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <string>
#include <vector>

#include "evaluation/results/set_digest.h"
#include "sim/base/sha256.h"
#include "tests/support/programs/benchmark_file.h"
#include "trainer/run/episode_data.h"

namespace earshot {
namespace {

using testing::HasSubstr;

using PrivateSet = BenchmarkFile;

/// The numbers of `first`, then those from 2,000,000,000 on: what a test draws is the same every time.
SecretSeeds seeds(std::vector<std::uint64_t> first = {}) {
  return [first, next = std::size_t{0}]() mutable {
    const std::size_t i = next++;
    return i < first.size() ? first[i] : 2'000'000'000 + i;
  };
}

TEST_F(PrivateSet, IsNamedByAHash) {
  section_ = "  private: {sha256: \"12ab\"}\n";
  EXPECT_THAT(refusal([&] { load(); }), HasSubstr("is not 64 hexadecimal digits"));
}

TEST_F(PrivateSet, IsOfTheSameKindAndNew) {
  make_public_set();
  EXPECT_THAT(refusal([&] { with_private_set(load(), path("public.json")); }), HasSubstr("has no private set"));
  const std::string sha256 = make_private_set(load(), path("private.json.gz"), seeds());
  EXPECT_EQ(sha256, sha256_hex(read_file(path("private.json.gz"))));
  EXPECT_EQ(std::filesystem::status(path("private.json.gz")).permissions(), std::filesystem::perms(0600));
  const EpisodeSet open = load_episode_set(path("public.json")), hidden = load_episode_set(path("private.json.gz"));
  ASSERT_EQ(hidden.episodes.size(), open.episodes.size());
  for (const Episode& episode : hidden.episodes) {
    EXPECT_TRUE(episode.scene_id.starts_with("house:") && episode.scene_id.ends_with(",rooms=2,area_m2=24")) << episode.scene_id;
    EXPECT_TRUE(std::ranges::none_of(open.episodes, [&](const Episode& other) { return other.scene_id == episode.scene_id; }));
    EXPECT_THAT(episode.sound, testing::AnyOf("synth:bird:2", testing::MatchesRegex("synth:(bird|noise):[0-9]{10,}")));
  }
  EXPECT_THAT(refusal([&] { make_private_set(load(), path("private.json.gz"), seeds()); }), HasSubstr("already exists"));
  make_private_set(load(), path("second.json.gz"), seeds({3'000'000'000}));

  section_ += "  private: {sha256: \"" + sha256 + "\"}\n";
  const Benchmark with_set = with_private_set(load(), path("private.json.gz"));
  EXPECT_EQ(benchmark_set(with_set).hash, hidden.hash);
  EXPECT_EQ(refusal([&] { check_private_split(load(), hidden); }), "");
  // Any other file is refused, be it a set that passes for one, and be it changed by a byte.
  EXPECT_THAT(refusal([&] { with_private_set(load(), path("second.json.gz")); }), HasSubstr("the private set of tiny 1 has " + sha256));
  std::string bytes = read_file(path("private.json.gz"));
  bytes[4] = static_cast<char>(bytes[4] ^ 1);  // the time in the head of gzip: the same episodes
  write_file_atomically(path("changed.json.gz"), bytes);
  ASSERT_EQ(load_episode_set(path("changed.json.gz")).hash, hidden.hash);
  EXPECT_THAT(refusal([&] { with_private_set(load(), path("changed.json.gz")); }), HasSubstr("has the SHA-256"));
}

// An index names its episodes by files beside it, episodes name scenes and sounds: another content is another hash.
TEST_F(PrivateSet, TheHashBindsWhatAnIndexNames) {
  make_public_set();
  make_private_set(load(), path("whole.json.gz"), seeds());
  EpisodeSet set = load_episode_set(path("whole.json.gz"));
  const auto digest = [&] { return digest_of_set(path("index.json"), "", folder_.path().string()); };
  const auto write_content = [&] {
    std::filesystem::create_directories(path("content"));
    save_episode_set(set, path("content/a.json.gz"));
    write_text(path("index.json"), "{\"episodes\": []}");
  };
  write_content();
  const std::string sha256 = digest();
  EXPECT_NE(sha256, sha256_hex(read_file(path("index.json"))));
  section_ += "  private: {sha256: \"" + sha256 + "\"}\n";
  EXPECT_EQ(benchmark_set(with_private_set(load(), path("index.json"))).episodes.size(), set.episodes.size());
  const auto expect_refused = [&] {
    EXPECT_THAT(refusal([&] { static_cast<void>(with_private_set(load(), path("index.json"))); }), HasSubstr("has the SHA-256"));
  };
  // Fewer episodes, easier ones, others of the same number.
  const EpisodeSet whole = set;
  set.episodes.pop_back();
  write_content();
  expect_refused();
  set = whole;
  set.episodes.back().geodesic_distance_m += 1;
  write_content();
  expect_refused();
  set = whole;
  write_content();
  EXPECT_EQ(digest(), sha256);
  // A further file of content.
  std::filesystem::copy_file(path("content/a.json.gz"), path("content/b.json.gz"));
  expect_refused();
  std::filesystem::remove(path("content/b.json.gz"));
  // Bytes of a scene, of what it names, and of a sound.
  set.episodes[0].scene_id = path("room.obj");
  set.episodes[1].sound = "ring.wav";
  write_text(path("room.obj"), "mtllib room.mtl\nv 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 2 3\n");
  write_text(path("room.mtl"), "newmtl a\nmap_Kd wall.png\n");
  write_text(path("wall.png"), "white");
  write_text(path("ring.wav"), "ring");
  write_content();
  std::set<std::string> digests{sha256, digest()};
  for (const char* file : {"room.obj", "room.mtl", "wall.png", "ring.wav"}) {
    const std::string was = read_file(path(file));
    write_text(path(file), was + "\n");
    EXPECT_TRUE(digests.insert(digest()).second) << file;
    write_text(path(file), was);
    EXPECT_FALSE(digests.insert(digest()).second) << file;
  }
  std::filesystem::remove(path("ring.wav"));
  EXPECT_THAT(refusal([&] { static_cast<void>(digest()); }), HasSubstr("ring.wav"));
}

TEST_F(PrivateSet, NumbersOfTheSystemDiffer) {
  const std::uint64_t first = secret_seed(), second = secret_seed();
  EXPECT_NE(first, second);
  EXPECT_GE(std::min(first, second), 1'000'000'000u);
}

// A house of the public set, a sound of it, and a house with too few places cost a draw each, not the set.
TEST_F(PrivateSet, WhatWillNotDoIsDrawnAgain) {
  config_.eval.filter = {.min_geodesic_m = 4.5f, .min_ratio = 1};
  config_.eval.filter.max_tries = 30;
  // Houses of this size in which paths of 4.5 m are and are not found.
  DataConfig data = load().run.eval;
  data.file = path("one.json");
  data.seed = 3'000'000'000;
  data.sounds = {"synth:bird:2"};
  std::vector<std::uint64_t> fit, small;
  for (std::uint64_t seed = 4'000'000'000; (fit.size() < 2 || small.empty()) && seed < 4'000'000'200; ++seed) {
    data.scenes = {"house:" + std::to_string(seed) + ",rooms=2,area_m2=24"};
    (refusal([&] { generate_data(data, load().run.env); }).empty() ? fit : small).push_back(seed);
  }
  ASSERT_GE(fit.size(), 2u);
  ASSERT_FALSE(small.empty());
  // The set's own seed, the two unheard sounds (the first is drawn twice), then houses.
  make_private_set(load(), path("private.json"), seeds({3'000'000'000, 9, 5, 6, small[0], 11, fit[0], fit[1]}));
  std::set<std::string> scenes, sounds;
  for (const Episode& episode : load_episode_set(path("private.json")).episodes) {
    scenes.insert(episode.scene_id.substr(0, episode.scene_id.find(',')));
    sounds.insert(episode.sound);
  }
  EXPECT_EQ(scenes, (std::set<std::string>{"house:" + std::to_string(fit[0]), "house:" + std::to_string(fit[1])}));
  EXPECT_FALSE(sounds.contains("synth:bird:9"));

  // One that is never found: an end, and nothing left behind.
  const SecretSeeds unusable_seeds = [&, draws = 0]() mutable { return draws++ == 0 ? data.seed : small[0]; };
  EXPECT_THAT(refusal([&] { make_private_set(load(), path("never.json"), unusable_seeds); }), HasSubstr("no episode"));
  EXPECT_THAT(refusal([&] { make_private_set(load(), path("never.json"), [] { return 9; }); }), HasSubstr("has no replacement"));
  EXPECT_FALSE(std::filesystem::exists(path("never.json")));
  for (const auto& entry : std::filesystem::directory_iterator(folder_.path()))
    EXPECT_FALSE(entry.path().filename().string().starts_with(".private")) << entry.path();
}

TEST_F(PrivateSet, OverlapsAreRefused) {
  make_public_set();
  make_private_set(load(), path("private.json"), seeds());
  const EpisodeSet good = load_episode_set(path("private.json"));
  const auto changed = [&](const std::string& scene, const std::string& sound) {
    EpisodeSet set = good;
    for (Episode& episode : set.episodes) {
      if (!scene.empty() && episode.scene_id == good.episodes[0].scene_id) episode.scene_id = scene;
      if (!sound.empty() && episode.sound == good.episodes[0].sound) episode.sound = sound;
    }
    return refusal([&] { check_private_split(load(), set); });
  };
  EXPECT_EQ(changed("", ""), "");
  EXPECT_THAT(changed("house:2", ""),
              HasSubstr("'house:2', the same as 'house:2,rooms=2,area_m2=24' of the training set or the public test set"));
  EXPECT_THAT(changed("house:11,rooms=3", ""), HasSubstr("'house:11,rooms=3', the same as 'house:11,rooms=2,area_m2=24'"));
  EXPECT_THAT(changed("", "synth:bird:1"), HasSubstr("'synth:bird:1'"));
  EXPECT_THAT(changed("", "synth:bird:9"), HasSubstr("'synth:bird:9'"));
  config_.train.sounds = {"synth:bird:0..2", "synth:noise:77"};
  EXPECT_THAT(changed("", ""), HasSubstr("'synth:noise:77' in data.train, which belongs to 'noise'"));
}

}  // namespace
}  // namespace earshot
