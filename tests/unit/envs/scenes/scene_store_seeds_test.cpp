// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <iterator>
#include <string>

#include "sim/acoustics/model/acoustic_image.h"
#include "sim/nav/navmesh_image.h"
#include "sim/scene/scene_image.h"
#include "tests/support/files/test_paths.h"

namespace earshot {
namespace {

/// What fuzz/scene_store.cpp reads a seed with: its scene, its config.
std::shared_ptr<const Scene> seed_room() { return std::make_shared<const Scene>(load_scene("shoebox:6x3x4@0.2")); }
AcousticConfig seed_config() {
  AcousticConfig config;
  config.rir_length_s = 0.1f;
  config.field = Switch::off;
  return config;
}

// A seed of another layout is refused at its first bytes, and the fuzzer finds nothing behind them.  EARSHOT_WRITE_FUZZ_SEEDS=1 writes the
// seeds of this layout; the first byte of each is the kind.
TEST(SceneStoreSeeds, AreOfThisLayout) {
  const std::shared_ptr<const Scene> room = seed_room();
  const std::filesystem::path folder = source_dir() / "fuzz/corpus/scene_store";
  const auto bytes_of = [&](const char* name) {
    std::ifstream file(folder / name, std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(file), {});
  };
  if (std::getenv("EARSHOT_WRITE_FUZZ_SEEDS") != nullptr) {
    const auto write = [&](const char* name, char kind, const std::string& bytes) {
      std::ofstream(folder / name, std::ios::binary) << kind << bytes;
    };
    write("scene", 0, encode_scene(*room));
    write("acoustics", 1, encode_acoustics(AcousticScene(room, seed_config())));
    write("navmesh", 2, encode_navmesh(Navmesh(room->mesh(), NavmeshConfig{})));
  }
  const std::string scene = bytes_of("scene"), acoustics = bytes_of("acoustics"), navmesh = bytes_of("navmesh");
  ASSERT_FALSE(scene.empty() || acoustics.empty() || navmesh.empty());
  EXPECT_EQ(scene[0], 0);
  EXPECT_EQ(acoustics[0], 1);
  EXPECT_EQ(navmesh[0], 2);
  EXPECT_EQ(decode_scene(std::string_view(scene).substr(1), "seed").hash(), room->hash());
  EXPECT_EQ(decode_acoustics(std::string_view(acoustics).substr(1), room, seed_config(), "seed").hash(),
            AcousticScene(room, seed_config()).hash());
  EXPECT_GT(decode_navmesh(std::string_view(navmesh).substr(1), {}, "seed").area_m2(), 10.0);
}

}  // namespace
}  // namespace earshot
