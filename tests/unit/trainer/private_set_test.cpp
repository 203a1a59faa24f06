// Test sets of which only a hash is public.
#include "trainer/private_set.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "sim/base/sha256.h"
#include "tests/support/benchmark_file.h"

namespace earshot {
namespace {

using testing::HasSubstr;

using PrivateSet = BenchmarkFile;

TEST_F(PrivateSet, IsNamedByAHash) {
  section_ = "  private: {sha256: \"12ab\"}\n";
  EXPECT_THAT(refusal([&] { load(); }), HasSubstr("is not 64 hexadecimal digits"));
}

TEST_F(PrivateSet, IsOfTheSameKindAndNew) {
  make_public_set();
  EXPECT_THAT(refusal([&] { with_private_set(load(), path("public.json")); }), HasSubstr("names no private set"));
  const std::string sha256 = make_private_set(load(), path("private.json.gz"));
  EXPECT_EQ(sha256, sha256_hex(read_file(path("private.json.gz"))));
  EXPECT_EQ(std::filesystem::status(path("private.json.gz")).permissions(), std::filesystem::perms(0600));
  const EpisodeSet open = load_episode_set(path("public.json")), hidden = load_episode_set(path("private.json.gz"));
  ASSERT_EQ(hidden.episodes.size(), open.episodes.size());
  for (const Episode& episode : hidden.episodes) {
    EXPECT_TRUE(episode.scene_id.starts_with("house:") && episode.scene_id.ends_with(",rooms=2,area_m2=24")) << episode.scene_id;
    EXPECT_TRUE(std::ranges::none_of(open.episodes, [&](const Episode& other) { return other.scene_id == episode.scene_id; }));
    EXPECT_THAT(episode.sound, testing::AnyOf("synth:bird:2", testing::MatchesRegex("synth:(bird|noise):[0-9]{10,}")));
  }
  EXPECT_THAT(refusal([&] { make_private_set(load(), path("private.json.gz")); }), HasSubstr("is there already"));
  EXPECT_NE(make_private_set(load(), path("second.json.gz")), sha256) << "two draws are the same";

  section_ += "  private: {sha256: \"" + sha256 + "\"}\n";
  const Benchmark with = with_private_set(load(), path("private.json.gz"));
  EXPECT_EQ(benchmark_set(with).hash, hidden.hash);
  EXPECT_EQ(refusal([&] { check_private_split(load(), hidden); }), "");
  // Any other file is refused, be it a set that passes for one, and be it changed by a byte.
  EXPECT_THAT(refusal([&] { with_private_set(load(), path("second.json.gz")); }), HasSubstr("the private set of tiny 1 has " + sha256));
  std::string bytes = read_file(path("private.json.gz"));
  bytes[4] = static_cast<char>(bytes[4] ^ 1);  // the time in the head of gzip: the same episodes
  write_file_atomically(path("changed.json.gz"), bytes);
  ASSERT_EQ(load_episode_set(path("changed.json.gz")).hash, hidden.hash);
  EXPECT_THAT(refusal([&] { with_private_set(load(), path("changed.json.gz")); }), HasSubstr("has the SHA-256"));
}

TEST_F(PrivateSet, OverlapsAreRefused) {
  make_public_set();
  make_private_set(load(), path("private.json"));
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
              HasSubstr("'house:2', the same as 'house:2,rooms=2,area_m2=24' of the training or the public test set"));
  EXPECT_THAT(changed("house:11,rooms=3", ""), HasSubstr("'house:11,rooms=3', the same as 'house:11,rooms=2,area_m2=24'"));
  EXPECT_THAT(changed("", "synth:bird:1"), HasSubstr("'synth:bird:1'"));
  EXPECT_THAT(changed("", "synth:bird:9"), HasSubstr("'synth:bird:9'"));
  config_.train.sounds = {"synth:bird:0..2", "synth:noise:77"};
  EXPECT_THAT(changed("", ""), HasSubstr("'synth:noise:77' in data.train, of the kind 'noise'"));
}

}  // namespace
}  // namespace earshot
