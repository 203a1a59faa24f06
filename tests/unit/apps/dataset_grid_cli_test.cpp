// SPDX-License-Identifier: Apache-2.0
// `earshot dataset grid` as a user runs it, interrupts it and fills the disk with it.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "datasets/grid/grid_files.h"
#include "sim/base/random.h"
#include "sim/vision/png_file.h"
#include "tests/support/envs/rir_corpus_cases.h"
#include "tests/support/files/test_data.h"
#include "tests/support/programs/background_program.h"
#include "tests/support/programs/cli.h"

namespace earshot {
namespace {

using corpus_cases::differences;
using corpus_cases::lines_of;
using corpus_cases::read_float_wav;
using corpus_cases::tree;
using testing::HasSubstr;

constexpr const char* kRoom = "shoebox:4.3x3x3.7@0.4";
constexpr const char* kQuick = " --length 0.1 --set rays=16 --set field=auto ";

/// Ears as points.txt has them, in our axes.
struct GridEars {
  double x = 0, y = 0, z = 0;
  [[nodiscard]] std::string text() const { return fmt::format("{},{},{}", x, y, z); }
};

class DatasetGridCli : public Cli {
 protected:
  [[nodiscard]] static std::uint32_t draw(std::uint32_t number, std::uint32_t below) {
    return RandomStream(11, Purpose::episode, 2, number, 0).below(below, 0);
  }
  [[nodiscard]] CliOutcome grid(const std::string& arguments) const { return earshot("dataset grid " + arguments); }
  void write_grid(const std::string& arguments) const {
    const CliOutcome outcome = grid(arguments);
    ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  }
  [[nodiscard]] std::vector<GridEars> points(const std::string& folder) const {
    std::istringstream text(read(folder + "/points.txt"));
    std::vector<GridEars> found;
    int index = 0;
    for (GridEars ears; text >> index >> ears.x >> ears.z >> ears.y; found.push_back(ears)) {
      EXPECT_EQ(index, static_cast<int>(found.size()));
      ears.z = -ears.z;  // the axes of the mesh have z up
    }
    return found;
  }
  /// A room of 3 x 2.5 x 3 m, seen from inside and outside alike, in units per metre; coloured: with z up, 2.6 m high, with a colour at
  /// each corner.
  [[nodiscard]] std::string write_box(const std::string& name, double units = 1, bool coloured = false) const {
    std::filesystem::create_directories(std::filesystem::path(file(name)).parent_path());
    std::string box;
    for (int corner = 0; corner < 8; ++corner) {
      box += fmt::format("v {} {} {}", corner & 1 ? 3 * units : 0, corner & 2 ? (coloured ? 3 : 2.5) * units : 0,
                         corner & 4 ? (coloured ? 2.6 : 3) * units : 0);
      for (std::uint32_t channel = 0; coloured && channel < 3; ++channel)
        box += fmt::format(" {}", draw(500 + 3 * static_cast<std::uint32_t>(corner) + channel, 1000) / 1000.0);
      box += '\n';
    }
    for (const char* face : {"1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"}) box += fmt::format("f {}\n", face);
    return write(name, box);
  }
  [[nodiscard]] std::map<std::string, std::string> files_of(const std::string& name) const { return tree(folder_ / name); }

  /// Responses between drawn pairs of points against `earshot rir` with the same options, and what only one of both is given.
  void expect_responses_of_rir(const std::string& scene, const std::string& options, const std::string& of_grid, const std::string& of_rir,
                               std::uint32_t pairs) const {
    for (const std::string channels : {"binaural", "ambisonic:2"}) {
      write_grid(scene + options + of_grid + " --name drawn --channels " + channels + " --out " + file("grid"));
      const std::vector<GridEars> ears = points("grid/metadata/mp3d/drawn");
      ASSERT_GE(ears.size(), 2u);
      const auto count = static_cast<std::uint32_t>(ears.size());
      for (std::uint32_t pair = 0; pair < pairs; ++pair) {
        const std::uint32_t source = draw(2 * pair, count), receiver = pair == 0 ? source : draw(2 * pair + 1, count);
        for (const int azimuth : {0, 90, 180, 270}) {
          const bool is_binaural = channels == "binaural";
          if (!is_binaural && azimuth > 0) continue;
          const std::string folder = is_binaural ? fmt::format("binaural_rirs/mp3d/drawn/{}", azimuth) : "ambisonic_rirs/mp3d/drawn";
          const CliOutcome rir =
              earshot(fmt::format("rir {}{}{} --channels {} --source {} --listener {} --heading {} --out {}", scene, options, of_rir,
                                  channels, ears[source].text(), ears[receiver].text(), (360 - azimuth) % 360, file("one.wav")));
          ASSERT_EQ(rir.exit_code, 0) << rir.errors;
          EXPECT_TRUE(read("one.wav") == read(fmt::format("grid/{}/{}_{}.wav", folder, receiver, source)))
              << channels << " " << receiver << "_" << source << " at " << azimuth;
        }
      }
    }
  }
};

TEST_F(DatasetGridCli, ResponsesAreThoseOfTheCommandRir) {
  expect_responses_of_rir("house:5,rooms=2,area_m2=20",
                          " --preset fast --set rir_length_s=0.2 --set rays=40 --set field=auto --seed 9 --rate 24000", " --spacing 1.3",
                          "", 4);
}

TEST_F(DatasetGridCli, ResponsesFromASourceFieldAreThoseOfTheCommandRir) {
  expect_responses_of_rir(kRoom, " --preset fast --set rir_length_s=0.1 --set sample_rate_hz=22050", " --spacing 1.5", " --set field=on",
                          2);
}

TEST_F(DatasetGridCli, ResponsesOfAMeshAreThoseOfTheCommandRir) {
  SKIP_WITHOUT_DATA("scenes/small_house.glb");
  expect_responses_of_rir((data_folder() / "scenes/small_house.glb").string(), " --preset fast --set rir_length_s=0.2 --set field=auto",
                          " --spacing 2", "", 2);
}

TEST_F(DatasetGridCli, PointsLieOnAGridAtTheHeightOfTheirDataSet) {
  for (const auto& [dataset, height_m, spacing_m, rate_hz] :
       {std::tuple("mp3d", 1.5, 1.0, 16000), std::tuple("replica", 1.5528907, 0.5, 44100), std::tuple("own", 1.5, 1.0, 16000)}) {
    write_grid(std::string(kRoom) + kQuick + "--threads 1 --format zarr --dataset " + dataset + " --name room --out " + file(dataset));
    const std::string metadata = fmt::format("{}/metadata/{}/room", dataset, dataset);
    const std::vector<GridEars> ears = points(metadata);
    ASSERT_GE(ears.size(), spacing_m < 1 ? 40u : 9u);
    for (std::size_t i = 0; i < ears.size(); ++i) {
      EXPECT_NEAR(ears[i].y, height_m, 2e-6);
      EXPECT_TRUE(ears[i].x > 0.05 && ears[i].x < 4.25 && ears[i].z > 0.05 && ears[i].z < 3.65);
      for (const double shift : {ears[i].x - ears[0].x, ears[i].z - ears[0].z})
        EXPECT_NEAR(shift / spacing_m, std::round(shift / spacing_m), 1e-5);
    }
    const nlohmann::json meta = parse_json(read(fmt::format("{}/binaural_rirs/{}/room/responses.zarr/.zarray", dataset, dataset)));
    const nlohmann::json shape = {ears.size(), ears.size(), 4, 2, rate_hz / 10};
    EXPECT_EQ(meta["shape"], shape);
    EXPECT_EQ(lines_of(file(fmt::format("{}/binaural_rirs/{}/room/manifest.jsonl", dataset, dataset))).size(), ears.size() * ears.size());
  }
}

TEST_F(DatasetGridCli, AnArrayHoldsTheSamplesOfTheFiles) {
  for (const std::string channels : {"binaural", "ambisonic:2"}) {
    const std::string common = std::string(kRoom) + kQuick + "--spacing 0.9 --name room --channels " + channels + " --out ";
    write_grid(common + file("files"));
    write_grid(common + file("array") + " --format zarr");
    const std::string kind = channels == "binaural" ? "binaural_rirs/mp3d/room" : "ambisonic_rirs/mp3d/room";
    const nlohmann::json meta = parse_json(read("array/" + kind + "/responses.zarr/.zarray"));
    const auto count = meta["shape"][0].get<std::size_t>(), of_chunk = meta["chunks"][1].get<std::size_t>();
    EXPECT_EQ(meta["dtype"], "<f4");
    EXPECT_EQ(meta["compressor"], nullptr);
    for (std::uint32_t pair = 0; pair < 6; ++pair) {
      const std::size_t source = draw(100 + pair, static_cast<std::uint32_t>(count)),
                        receiver = draw(200 + pair, static_cast<std::uint32_t>(count));
      const std::vector<int> azimuths = channels == "binaural" ? std::vector{0, 90, 180, 270} : std::vector{-1};
      std::vector<float> expected;
      for (const int azimuth : azimuths) {
        const std::string folder = azimuth < 0 ? kind : fmt::format("{}/{}", kind, azimuth);
        for (const std::vector<float>& channel : read_float_wav(read(fmt::format("files/{}/{}_{}.wav", folder, receiver, source))).channels)
          expected.insert(expected.end(), channel.begin(), channel.end());
      }
      ASSERT_FALSE(expected.empty());
      const std::string chunk =
          read(fmt::format("array/{}/responses.zarr/{}.{}{}", kind, source, receiver / of_chunk, azimuths.size() > 1 ? ".0.0.0" : ".0.0"));
      ASSERT_EQ(chunk.size(), of_chunk * expected.size() * sizeof(float));
      EXPECT_EQ(std::memcmp(chunk.data() + receiver % of_chunk * expected.size() * sizeof(float), expected.data(),
                            expected.size() * sizeof(float)),
                0);
    }
  }
}

TEST_F(DatasetGridCli, ProcessesThreadsAndKillsChangeNoByte) {
  for (const std::string form : {" --pictures 16x12", " --format zarr --channels ambisonic:1"}) {
    const std::string scene = std::string("house:3,rooms=1,area_m2=20") + kQuick + "--spacing 0.8 --name room" + form,
                      tag = form.substr(3, 2);
    write_grid(scene + " --threads 1 --out " + file(tag + "whole"));
    const auto whole = files_of(tag + "whole");
    // Two processes at once, one of them on two threads; then either completes the index.
    {
      const std::string command = "\"$EARSHOT\" dataset grid " + scene + " --out " + file(tag + "shards");
      const std::string program = "EARSHOT=" + earshot_program().string() + "; export EARSHOT; ";
      BackgroundProgram first(program + command + " --shard 1/2 --threads 1", file("first"));
      BackgroundProgram second(program + command + " --shard 2/2 --threads 2", file("second"));
      EXPECT_EQ(first.wait(), 0) << first.text();
      EXPECT_EQ(second.wait(), 0) << second.text();
    }
    write_grid(scene + " --shard 1/2 --out " + file(tag + "shards"));
    EXPECT_EQ(differences(files_of(tag + "shards"), whole), std::vector<std::string>{});
    // Killed while it writes the manifests of drawn sources, and completed.
    const auto count = static_cast<std::uint32_t>(points(tag + "whole/metadata/mp3d/room").size());
    std::string kind = form.find("ambisonic") == std::string::npos ? "binaural_rirs" : "ambisonic_rirs";
    std::uint32_t from = 0, killed = 0;
    for (std::uint32_t kill = 0; kill < 3; ++kill) {
      from += draw(300 + kill, count / 3);
      BackgroundProgram run("exec " + earshot_program().string() + " dataset grid " + scene + " --threads 2 --out " + file(tag + "killed"),
                            file("kill"));
      ASSERT_TRUE(BackgroundProgram::wait_for(folder_ / (tag + "killed") / kind / "mp3d/room/parts" / fmt::format("{:05}", from) /
                                              "manifest.jsonl"));
      run.signal(SIGKILL);
      const int code = run.wait();
      ASSERT_THAT(code, testing::AnyOf(0, 128 + SIGKILL));
      killed += code != 0;
    }
    ASSERT_GE(killed, 1u) << "no run was killed before it was complete";
    write_grid(scene + " --out " + file(tag + "killed"));
    EXPECT_EQ(differences(files_of(tag + "killed"), whole), std::vector<std::string>{});
    write_grid(scene + " --out " + file(tag + "killed"));  // complete: nothing to do
    EXPECT_EQ(differences(files_of(tag + "killed"), whole), std::vector<std::string>{});
  }
}

TEST_F(DatasetGridCli, WhatCannotBeWrittenIsOneLineAndLeavesNothing) {
  const std::string out = " --out " + file("refused"), room = kRoom;
  for (const auto& [arguments, text] :
       std::vector<std::pair<std::string, std::string>>{{room + " --spacing 20", "gives 1 point on"},
                                                        {room + " --spacing 0", "--spacing = 0"},
                                                        {room + " --spacing nan", "--spacing"},
                                                        {"shoebox:40x3x40@0.4 --spacing 0.1", "more than 10000"},
                                                        {room + " --channels mono", "use binaural or ambisonic:ORDER"},
                                                        {room + " --channels ambisonic:2:ego", "use binaural or ambisonic:ORDER"},
                                                        {room + " --channels ambisonic:2 --hrtf none.sofa", "--hrtf has no effect"},
                                                        {room + " --hrtf none.sofa", "none.sofa"},
                                                        {room + " --name a/b", "--name a/b"},
                                                        {room + " --dataset ..", "--dataset .."},
                                                        {room + " --name room.zarr", "use a name without .zarr"},
                                                        {room + " --name room.PKL", "use a name without .pkl"},
                                                        {room + " --pictures 100", "--pictures 100"},
                                                        {room + " --pictures 9000x9000", "width"},
                                                        {room + " --length 0", "--length = 0"},
                                                        {room + " --length 1 --set rir_length_s=2", "give either --length or this key"},
                                                        {room + " --set threads=2", "use the option --threads"},
                                                        {room + " --set glide_paths=2", "has no effect"},
                                                        {room + " --set raya=2", "did you mean 'rays'"},
                                                        {room + " --threads -1", "--threads"},
                                                        {room + " --shard 3/2", "K from 1 to N"},
                                                        {room + " --format hdf5", "hdf5"},
                                                        {room + " --points 5", "--points"},
                                                        {"none.glb", "none.glb"}}) {
    expect_bad_input("dataset grid " + arguments + out, text);
    EXPECT_FALSE(std::filesystem::exists(folder_ / "refused")) << arguments;
  }
}

TEST_F(DatasetGridCli, AFolderThatWasBegunOtherwiseIsRefused) {
  const std::string out = std::string(kQuick) + "--name room --out " + file("grid"), room = kRoom;
  write_grid(room + out + " --spacing 1.2");
  const auto before = files_of("grid");
  for (const auto& [arguments, text] : std::vector<std::pair<std::string, std::string>>{
           {room + out + " --spacing 1.1", "'spacing_m: 1.2' there, 'spacing_m: 1.1' here"},
           {room + out + " --spacing 1.2 --seed 4", "'seed: 0' there, 'seed: 4' here"},
           {room + out + " --spacing 1.2 --format zarr", "'format: wav' there, 'format: zarr' here"},
           {room + out + " --spacing 1.2 --pictures 8x8", "'pictures: none' there, 'pictures: 8x8' here"},
           {"shoebox:4.3x3x3.8@0.4" + out + " --spacing 1.2", "shoebox:4.3x3x3.8"},
           // Ambisonics of a grid have the points of its responses for two ears.
           {room + out + " --spacing 1.1 --channels ambisonic:2", "points.txt: lists other points"}}) {
    expect_bad_input("dataset grid " + arguments, text);
    EXPECT_EQ(differences(files_of("grid"), before), std::vector<std::string>{}) << arguments;
  }
  write_grid(room + out + " --spacing 1.2 --channels ambisonic:2");
  EXPECT_TRUE(std::filesystem::exists(folder_ / "grid/ambisonic_rirs/mp3d/room/1_0.wav"));
}

TEST_F(DatasetGridCli, NamesComeFromThePathOfTheScene) {
  const std::string mesh = write_box("data/scene_datasets/replica/attic_2/habitat/mesh.obj");
  write_grid(mesh + kQuick + "--spacing 1.4 --out " + file("grid"));
  EXPECT_TRUE(std::filesystem::exists(folder_ / "grid/binaural_rirs/replica/attic_2/270/0_1.wav"));
  write_grid("house:3,rooms=1,area_m2=20" + std::string(kQuick) + "--spacing 1.4 --out " + file("grid"));
  EXPECT_TRUE(std::filesystem::exists(folder_ / "grid/metadata/mp3d/house_3/points.txt"));
}

TEST_F(DatasetGridCli, APathWithoutAFolderOfTheSceneIsNamedInOneLine) {
  const std::string box = write_box("data/scene_datasets/replica/room.obj");
  const std::string options = kQuick + std::string("--spacing 1.4 --out ") + file("grid");
  const CliOutcome outcome = grid(box + options);
  ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  EXPECT_THAT(outcome.errors, HasSubstr("warning: " + box + " has no folder of the scene"));
  EXPECT_TRUE(std::filesystem::exists(folder_ / "grid/metadata/mp3d/room/points.txt"));
  EXPECT_THAT(grid(box + options + " --dataset replica").errors, testing::Not(HasSubstr("no folder of the scene")));
}

TEST_F(DatasetGridCli, PicturesOfASceneWithOverridesAreThoseOfRender) {
  // A room of 3 x 3 x 2.6 m with z up and corners of many colours, in metres and in hundredths.
  for (const auto& [unit, overrides] : {std::pair(1.0, " --up z"), std::pair(100.0, " --up z --unit 0.01")}) {
    const std::string mesh = write_box("colours.obj", unit, true);
    write_grid(mesh + kQuick + overrides + " --spacing 1.4 --pictures 24x18 --name room --out " + file("grid") + fmt::format("{}", unit));
    const std::string at = fmt::format("grid{}", unit);
    const std::vector<GridEars> ears = points(at + "/metadata/mp3d/room");
    ASSERT_GE(ears.size(), 2u);
    const auto point = draw(static_cast<std::uint32_t>(400 + unit), static_cast<std::uint32_t>(ears.size()));
    const std::string npy = read(fmt::format("{}/scene_observations/mp3d/room/{}.rgb.npy", at, point));
    constexpr std::size_t of_view = std::size_t{24} * 18 * 3;
    ASSERT_GT(npy.size(), 4 * of_view);
    for (std::size_t heading = 0; heading < 4; ++heading) {
      std::vector<std::uint8_t> rgb(of_view);
      std::memcpy(rgb.data(), npy.data() + npy.size() - (4 - heading) * of_view, of_view);
      const CliOutcome render = earshot(fmt::format("render {}{} --size 24x18 --pose={:.6f},{:.6f},{:.6f},{} --out {}", mesh, overrides,
                                                    ears[point].x, ears[point].y - 1.5, ears[point].z, 90 * heading, file("view.png")));
      ASSERT_EQ(render.exit_code, 0) << render.errors;
      EXPECT_TRUE(read("view.png") == encode_png_rgb("view", 24, 18, rgb)) << "point " << point << ", heading " << 90 * heading;
    }
  }
}

TEST_F(DatasetGridCli, CorporaOfOneSceneShareItsMaterialsAndItsPictures) {
  const std::string out = std::string(kQuick) + "--spacing 1.2 --name room --out " + file("grid"), room = kRoom;
  write_grid(room + out + " --pictures 8x6");
  const auto before = files_of("grid");
  const std::string harmonics = out + " --channels ambisonic:1";
  for (const auto& [arguments, text] : std::vector<std::pair<std::string, std::string>>{
           {"shoebox:4.3x3x3.7@0.2" + harmonics, "scene.json: is of another scene"},  // the same points
           {room + harmonics + " --pictures 6x8", "pictures.json: is of pictures of another size"}}) {
    expect_bad_input("dataset grid " + arguments, text);
    EXPECT_EQ(differences(files_of("grid"), before), std::vector<std::string>{}) << arguments;
  }
  std::filesystem::remove(folder_ / "grid/metadata/mp3d/room/scene.json");
  expect_bad_input("dataset grid " + room + harmonics, "has points, but no scene.json");
  write("grid/metadata/mp3d/room/scene.json", before.at("metadata/mp3d/room/scene.json"));
  write_grid(room + harmonics + " --pictures 8x6");
}

TEST_F(DatasetGridCli, TheShortestResponseHasOneSample) {
  for (const std::string format : {"zarr", "wav"}) {
    write_grid(std::string(kRoom) + " --spacing 1.2 --set rays=16 --length 0.00001 --name room --format " + format + " --out " +
               file(format));
    EXPECT_EQ(lines_of(file(format + "/binaural_rirs/mp3d/room/manifest.jsonl")).at(1)["num_samples"], 1);
  }
  EXPECT_EQ(parse_json(read("zarr/binaural_rirs/mp3d/room/responses.zarr/.zarray"))["shape"][4], 1);
}

TEST_F(DatasetGridCli, AnArrayThatIsWrittenAgainIsNotComplete) {
  const std::string scene = std::string(kRoom) + kQuick + "--spacing 1.2 --name room --format zarr --out " + file("grid"),
                    folder = "grid/binaural_rirs/mp3d/room/";
  write_grid(scene);
  EXPECT_TRUE(std::filesystem::exists(file(folder + "responses.zarr/.zarray")));
  std::filesystem::remove_all(file(folder + "parts"));
  for (const char* name : {"corpus.json", "manifest.jsonl"}) std::filesystem::remove(file(folder + name));
  write_grid(scene + " --seed 3 --shard 1/2");
  EXPECT_FALSE(std::filesystem::exists(file(folder + "responses.zarr/.zarray")));
  write_grid(scene + " --seed 3 --shard 2/2");
  EXPECT_TRUE(std::filesystem::exists(file(folder + "responses.zarr/.zarray")));
}

// The parts and the joined manifest hold the names of all files, which may be long.
TEST_F(DatasetGridCli, TheEstimateOfSpaceHoldsForLongNames) {
  const std::string name(200, 'n'), set(200, 'd');
  write_grid(std::string(kRoom) + kQuick + "--spacing 1.2 --name " + name + " --dataset " + set + " --out " + file("grid"));
  const std::string folder = "binaural_rirs/" + set + "/" + name;
  const std::size_t count = points("grid/metadata/" + set + "/" + name).size();
  const GridFiles files({.folder = folder, .num_points = count, .num_channels = 2, .num_samples = 1600, .has_azimuths = true});
  constexpr std::uint64_t block = 4096;
  std::uint64_t bytes = 0;
  for (const auto& [path, content] : files_of("grid/" + folder)) {
    if (path.ends_with(".wav")) bytes += (content.size() + block - 1) / block * block;
    if (path.ends_with("manifest.jsonl")) bytes += content.size();
  }
  EXPECT_LE(bytes, count * files.bytes_of_source());
}

// A disk that is too small from the beginning, and one that another program fills.
TEST_F(DatasetGridCli, AFullDiskLeavesNothingThatLooksComplete) {
  if (std::system("unshare -Urm mount -t tmpfs tmpfs /mnt 2>/dev/null") != 0) GTEST_SKIP() << "no file system can be mounted here";
  const std::string scene = std::string(kRoom) + kQuick + "--spacing 0.8 --threads 1 --name room", disk = file("disk");
  write_grid(scene + " --out " + file("whole"));
  std::filesystem::create_directory(disk);
  const std::string program = earshot_program().string() + " dataset grid " + scene + " --out " + disk + "/grid";
  const auto on_disk = [&](const std::string& size, const std::string& script) {
    return run("unshare -Urm sh -c 'mount -t tmpfs -o size=" + size + " tmpfs " + disk + " && " + script + "'");
  };
  const CliOutcome small = on_disk("300k", program + "; code=$?; ls -A " + disk + "; exit $code");
  EXPECT_EQ(small.exit_code, 2);
  EXPECT_EQ(small.output, "");
  EXPECT_THAT(small.errors, HasSubstr("GB are free"));
  EXPECT_EQ(std::ranges::count(small.errors, '\n'), 1) << small.errors;
  // The filler begins once the run has; when it is gone, the same command completes the grid.
  const std::string state = disk + "/grid/binaural_rirs/mp3d/room/";
  const std::string filled = "( for i in $(seq 3000); do [ -e " + state + "parts/00000/manifest.jsonl ] && break; sleep 0.02; done; " +
                             "cat /dev/zero >" + disk + "/filler 2>/dev/null ) & " + program + "; code=$?; wait; ls " + state +
                             "manifest.jsonl 2>/dev/null; rm " + disk + "/filler; " + program + " >/dev/null && cp -r " + disk + "/grid " +
                             file("completed") + "; exit $code";
  const CliOutcome full = on_disk("80m", filled);
  EXPECT_EQ(full.exit_code, 1) << full.output << full.errors;
  EXPECT_EQ(full.output, "");
  EXPECT_THAT(full.errors, HasSubstr("No space left on device"));
  EXPECT_EQ(differences(files_of("completed"), files_of("whole")), std::vector<std::string>{});
}

}  // namespace
}  // namespace earshot
