// SPDX-License-Identifier: Apache-2.0
#include "envs/episodes/episode_set.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>

#include "envs/episodes/gzip.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

using testing::HasSubstr;

const std::string kExample = R"({"episodes":[{"episode_id":"0","scene_id":"mp3d/AAAA/AAAA.glb","start_position":[1.0,0.1,-2.0],
  "start_rotation":[0,0.7071,0,0.7071],"info":{"geodesic_distance":7.5,"num_action":11,"sound":"my_ring"},
  "goals":[{"position":[4.0,0.1,1.5],"radius":1e-05}],"start_room":null,"shortest_paths":null}]})";

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const auto at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

std::string error_of(const std::string& text) {
  try {
    parse_episode_set(text, "set.json");
  } catch (const InputError& error) {
    return error.what();
  }
  return "no error";
}

class EpisodeSetFile : public testing::Test {
 protected:
  EpisodeSetFile() : folder_(std::filesystem::temp_directory_path() / ("earshot_set_" + std::to_string(::getpid()))) {
    std::filesystem::create_directories(folder_);
  }
  ~EpisodeSetFile() override { std::filesystem::remove_all(folder_); }
  std::filesystem::path folder_;
};

void expect_same(const Episode& a, const Episode& b) {
  EXPECT_EQ(a.episode_id, b.episode_id);
  EXPECT_EQ(a.scene_id, b.scene_id);
  EXPECT_EQ(a.start_position, b.start_position);
  EXPECT_EQ(a.start_rotation, b.start_rotation);
  EXPECT_EQ(a.goal_position, b.goal_position);
  EXPECT_EQ(a.goal_radius_m, b.goal_radius_m);
  EXPECT_EQ(a.geodesic_distance_m, b.geodesic_distance_m);
  EXPECT_EQ(a.num_action, b.num_action);
  EXPECT_EQ(a.sound, b.sound);
}

TEST(Episode, HeadingTurnsCounterClockwiseFromMinusZ) {
  EXPECT_NEAR(heading_of({0, 0, 0, 1}), 0.0, 1e-12);
  // A quarter turn about +y takes -z to -x: the agent's left.  0.7071 is not normalised to double precision.
  EXPECT_NEAR(heading_of({0, 0.7071f, 0, 0.7071f}), std::numbers::pi / 2, 1e-6);
  EXPECT_NEAR(heading_of({0, -0.7071f, 0, 0.7071f}), -std::numbers::pi / 2, 1e-6);
  EXPECT_NEAR(heading_of({0, 14.142f, 0, 14.142f}), std::numbers::pi / 2, 1e-6);
  EXPECT_NEAR(std::abs(heading_of({0, 1, 0, 0})), std::numbers::pi, 1e-6);
}

TEST(Episode, RotationOfIsTheInverseOfHeadingOf) {
  for (int turn = -17; turn <= 17; ++turn) {
    const double heading_rad = turn * std::numbers::pi / 18;
    EXPECT_NEAR(heading_of(rotation_of(heading_rad)), heading_rad, 3e-7);  // two float32 roundings of 6e-8, at worst doubled by atan2
  }
}

TEST(Episode, LookingStraightUpHasSomeFiniteHeading) {
  const float s = std::sqrt(0.5f);
  EXPECT_TRUE(std::isfinite(heading_of({s, 0, 0, s})));
}

TEST(Episode, ZeroOrNanQuaternionIsRefused) {
  EXPECT_THROW(heading_of({0, 0, 0, 0}), InputError);
  EXPECT_THROW(heading_of({0, NAN, 0, 1}), InputError);
  EXPECT_THROW(heading_of({0, INFINITY, 0, 1}), InputError);
}

TEST(EpisodeSet, ReadsTheAudioNavLayout) {
  const EpisodeSet set = parse_episode_set(kExample, "set.json");
  ASSERT_EQ(set.episodes.size(), 1u);
  const Episode& episode = set.episodes[0];
  EXPECT_EQ(episode.episode_id, "0");
  EXPECT_EQ(episode.scene_id, "mp3d/AAAA/AAAA.glb");
  EXPECT_EQ(episode.start_position, glm::dvec3(1.0, 0.1, -2.0));
  EXPECT_EQ(episode.start_rotation, (std::array<float, 4>{0, 0.7071f, 0, 0.7071f}));
  EXPECT_EQ(episode.goal_position, glm::dvec3(4.0, 0.1, 1.5));
  EXPECT_EQ(episode.goal_radius_m, 1e-5f);
  EXPECT_EQ(episode.geodesic_distance_m, 7.5f);
  EXPECT_EQ(episode.num_action, 11);
  EXPECT_EQ(episode.sound, "my_ring");
}

TEST(EpisodeSet, DropsTheDatasetFolderOfTheOriginal) {
  const auto text = replaced(kExample, "\"mp3d/AAAA", "\"data/scene_datasets/mp3d/AAAA");
  EXPECT_EQ(parse_episode_set(text, "set.json").episodes[0].scene_id, "mp3d/AAAA/AAAA.glb");
}

TEST(EpisodeSet, AcceptsWhatSomePublishedSetsWrite) {
  EXPECT_EQ(parse_episode_set(replaced(kExample, "\"episode_id\":\"0\"", "\"episode_id\":17"), "set").episodes[0].episode_id, "17");
  EXPECT_EQ(parse_episode_set(replaced(kExample, "7.5", "7"), "set").episodes[0].geodesic_distance_m, 7.f);
  EXPECT_EQ(
      parse_episode_set(replaced(kExample, "\"start_room\":null", "\"offset\":3,\"start_room\":{\"a\":[1,{\"episodes\":[2]}]}"), "set")
          .episodes.size(),
      1u);
}

TEST(EpisodeSet, GzipIsFoundByContent) {
  EXPECT_EQ(parse_episode_set(gzip(kExample), "plain_name.json").hash, parse_episode_set(kExample, "x").hash);
}

TEST_F(EpisodeSetFile, RoundTripsBitForBitPlainAndGzip) {
  EpisodeSet set;
  const RandomStream random(7, Purpose::test);
  for (std::uint32_t i = 0; i < 50; ++i) {
    const auto u = random.uniform4(2 * i), v = random.uniform4(2 * i + 1);
    set.episodes.push_back({.episode_id = "e" + std::to_string(i),
                            .scene_id = "house:" + std::to_string(i),
                            .start_position = {100 * u[0] - 50, u[1] * 1e-3f, -20 * u[2]},
                            .start_rotation = rotation_of(6.0 * u[3]),
                            .goal_position = {v[0], v[1], v[2]},
                            .geodesic_distance_m = v[3] * 30 + 0.1f,
                            .num_action = static_cast<int>(i) + 1,
                            .sound = "sounds/\"quoted\"\\\u00e9 \t.wav"});
  }
  set.hash = episode_set_hash(set.episodes);
  for (const char* name : {"set.json", "set.json.gz"}) {
    save_episode_set(set, folder_ / name);
    const std::string first = read_file(folder_ / name);
    EXPECT_EQ(is_gzip(first), std::string(name).ends_with(".gz"));
    const EpisodeSet loaded = load_episode_set(folder_ / name);
    ASSERT_EQ(loaded.episodes.size(), set.episodes.size());
    for (std::size_t i = 0; i < set.episodes.size(); ++i) expect_same(loaded.episodes[i], set.episodes[i]);
    EXPECT_EQ(loaded.hash, set.hash);
    save_episode_set(loaded, folder_ / name);
    EXPECT_EQ(read_file(folder_ / name), first);
  }
  std::swap(set.episodes[0], set.episodes[1]);
  EXPECT_NE(episode_set_hash(set.episodes), set.hash);  // the order is part of the set
}

TEST_F(EpisodeSetFile, ReadsSetsThatAreSplitByScene) {
  std::filesystem::create_directories(folder_ / "content");
  std::ofstream(folder_ / "val.json") << R"({"episodes": []})";
  std::ofstream(folder_ / "content" / "B.json.gz") << gzip(replaced(kExample, "\"0\"", "\"b\""));
  std::ofstream(folder_ / "content" / "A.json.gz") << gzip(replaced(kExample, "\"0\"", "\"a\""));
  std::ofstream(folder_ / "content" / "notes.txt") << "not a set";
  const EpisodeSet set = load_episode_set(folder_ / "val.json");
  ASSERT_EQ(set.episodes.size(), 2u);
  EXPECT_EQ(set.episodes[0].episode_id, "a");
  EXPECT_EQ(set.episodes[1].episode_id, "b");

  std::filesystem::rename(folder_ / "content", folder_ / "scenes");
  std::ofstream(folder_ / "val.json") << R"({"content_scenes_path": "{data_path}/scenes/{scene}.json.gz", "episodes": []})";
  EXPECT_EQ(load_episode_set(folder_ / "val.json").episodes.size(), 2u);
}

TEST_F(EpisodeSetFile, MissingAndEmptyFilesAreNamed) {
  EXPECT_THROW(load_episode_set(folder_ / "none.json.gz"), InputError);
  EXPECT_THROW(load_episode_set(folder_), InputError);
  std::ofstream(folder_ / "empty.json") << "";
  EXPECT_THROW(load_episode_set(folder_ / "empty.json"), InputError);
}

TEST(EpisodeSet, EveryKeyThatIsMissingIsNamedWithItsEpisode) {
  const std::pair<const char*, const char*> cases[] = {{"\"scene_id\"", "scene_id is missing"},
                                                       {"\"start_position\"", "start_position is missing"},
                                                       {"\"start_rotation\"", "start_rotation is missing"},
                                                       {"\"info\"", "info is missing"},
                                                       {"\"geodesic_distance\"", "info.geodesic_distance is missing"},
                                                       {"\"num_action\"", "info.num_action is missing"},
                                                       {"\"sound\"", "info.sound is missing"},
                                                       {"\"goals\"", "goals is missing"},
                                                       {"\"position\"", "goals[0].position is missing"}};
  for (const auto& [key, message] : cases) {
    const std::string error = error_of(replaced(kExample, key, "\"other\""));
    EXPECT_THAT(error, HasSubstr(message));
    EXPECT_THAT(error, HasSubstr("episode '0'"));
    EXPECT_THAT(error, HasSubstr("set.json"));
  }
  EXPECT_THAT(error_of(replaced(kExample, "\"episode_id\"", "\"other\"")), HasSubstr("episode number 0: episode_id is missing"));
}

TEST(EpisodeSet, BadValuesAreNamed) {
  const struct {
    const char *from, *to, *message;
  } cases[] = {{"[1.0,0.1,-2.0]", "[1.0,0.1]", "start_position must be a list of 3 numbers"},
               {"[1.0,0.1,-2.0]", "[1.0,\"a\",2]", "start_position must be a number"},
               {"[1.0,0.1,-2.0]", "[1.0,null,2]", "start_position must be a number"},
               {"[1.0,0.1,-2.0]", "[1e200,0,0]", "start_position must be a finite number"},
               {"[1.0,0.1,-2.0]", "[NaN,0,0]", "is not valid JSON"},
               {"[1.0,0.1,-2.0]", "[1e999,0,0]", "is not valid JSON"},
               {"[0,0.7071,0,0.7071]", "[0,0,0,0]", "start_rotation is a zero quaternion"},
               {"[0,0.7071,0,0.7071]", "7", "start_rotation must be a list of 4 numbers"},
               {"7.5", "0", "info.geodesic_distance must be positive"},
               {"7.5", "-1", "info.geodesic_distance must be positive"},
               {"7.5", "1e39", "info.geodesic_distance must be a finite number"},
               {"7.5", "Infinity", "is not valid JSON"},
               {"7.5", "null", "info.geodesic_distance must be a number"},
               {":11", ":1.5", "info.num_action must be a whole number"},
               {":11", ":0", "info.num_action must be a whole number of at least 1"},
               {":11", ":99999999999999", "info.num_action must be a whole number"},
               {"\"my_ring\"", "3", "info.sound must be text"},
               {"\"my_ring\"", "\"\"", "info.sound is empty"},
               {"\"mp3d/AAAA/AAAA.glb\"", "\"data/scene_datasets/\"", "scene_id is empty"},
               {"\"0\"", "[]", "episode_id must be text"}};
  for (const auto& c : cases) EXPECT_THAT(error_of(replaced(kExample, c.from, c.to)), HasSubstr(c.message)) << c.to;
}

TEST(EpisodeSet, WrongDocumentsAreRefused) {
  EXPECT_THAT(error_of("{\"episodes\":[]}"), HasSubstr("contains no episodes"));
  EXPECT_THAT(error_of("[]"), HasSubstr("no list `episodes`"));
  EXPECT_THAT(error_of("{}"), HasSubstr("no list `episodes`"));
  EXPECT_THAT(error_of("{\"episodes\":{\"a\":{}}}"), HasSubstr("episode_id is missing"));
  EXPECT_THAT(error_of("{\"episodes\":{\"a\":1}}"), HasSubstr("set.json"));
  EXPECT_THAT(error_of("{\"episodes\":[1]}"), HasSubstr("not an object"));
  EXPECT_THAT(error_of("{\"episodes\":[[]]}"), HasSubstr("not an object"));
  EXPECT_THAT(error_of("{\"episodes\":[null]}"), HasSubstr("not an object"));
  EXPECT_THAT(error_of("7"), HasSubstr("no list `episodes`"));
  EXPECT_THAT(error_of(kExample + "x"), HasSubstr("is not valid JSON"));
  EXPECT_THAT(error_of(std::string(kExample) + std::string(1, '\0') + "x"), HasSubstr("is NUL and text follows"));
  EXPECT_THAT(error_of(std::string(200000, '[')), HasSubstr("levels deep"));  // json_depth.h, before it is parsed
}

TEST(Gzip, CutDamagedAndTrailingStreamsAreRefused) {
  const std::string packed = gzip(kExample);
  EXPECT_EQ(gunzip(packed, "x", 1 << 20), kExample);
  EXPECT_EQ(gunzip(packed + packed, "x", 1 << 20), kExample + kExample);  // members follow each other (RFC 1952, section 2.2)
  EXPECT_EQ(gunzip(packed + std::string(512, '\0'), "x", 1 << 20), kExample);
  for (std::size_t size = 2; size < packed.size(); ++size) EXPECT_THROW(gunzip(packed.substr(0, size), "x", 1 << 20), InputError) << size;
  std::string wrong_sum = packed;
  wrong_sum[packed.size() - 6] ^= 1;
  EXPECT_THROW(gunzip(wrong_sum, "x", 1 << 20), InputError);
  EXPECT_THROW(gunzip(packed + "garbage", "x", 1 << 20), InputError);
}

TEST(Gzip, OutputIsBounded) {
  const std::string bomb = gzip(std::string(std::size_t{4} << 20, 'a'));
  EXPECT_LT(bomb.size(), 10'000u);
  EXPECT_THROW(gunzip(bomb, "x", (std::size_t{4} << 20) - 1), InputError);
  EXPECT_EQ(gunzip(bomb, "x", std::size_t{4} << 20).size(), std::size_t{4} << 20);
}

TEST(EpisodeSet, RandomDamageGivesAnErrorOrASet) {
  const std::string sources[] = {kExample, gzip(kExample)};
  int refused = 0;
  for (std::uint32_t trial = 0; trial < 1000; ++trial) {
    const RandomStream random(11, Purpose::test, trial);
    std::string text = sources[trial % 2];
    const std::uint32_t edits = 1 + random.below(4, 0);
    for (std::uint32_t edit = 0; edit < edits; ++edit) {
      const auto at = random.below(static_cast<std::uint32_t>(text.size()), 1 + 4 * edit);
      const auto kind = random.below(4, 2 + 4 * edit);
      const auto byte = static_cast<char>(random.bits(3 + 4 * edit));
      if (kind == 0)
        text[at] = byte;
      else if (kind == 1)
        text.insert(at, 1, byte);
      else if (kind == 2)
        text.erase(at, 1 + random.below(8, 4 + 4 * edit));
      else
        text = text.substr(0, at) + "}]0.-e,\"" + text.substr(at);
      if (text.empty()) text = " ";
    }
    try {
      const EpisodeSet set = parse_episode_set(text, "fuzz");
      for (const Episode& episode : set.episodes) {
        EXPECT_TRUE(std::isfinite(episode.geodesic_distance_m) && episode.geodesic_distance_m > 0);
        EXPECT_TRUE(std::isfinite(heading_of(episode.start_rotation)));
      }
    } catch (const InputError&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 500);  // the damage does bite
}

}  // namespace
}  // namespace earshot
