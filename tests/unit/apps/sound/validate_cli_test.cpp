// SPDX-License-Identifier: Apache-2.0
// `earshot validate`: measured responses beside simulated ones.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/base/text/json.h"
#include "tests/support/files/measured_room_files.h"
#include "tests/support/files/test_data.h"

namespace earshot {
namespace {

class ValidateCli : public MeasuredRoomFiles {};

// The engine against itself under other seeds: what is left is the spread of one draw of the noise.  At T = 0.4 s an octave has 2 B T
// / 13.8 independent parts, 20 at 500 Hz and 160 at 4 kHz, so that its energy scatters by 1.3 to 0.5 dB: 0.7 dB in the mean of sizes over
// four octaves.  Decay times scatter by 1.6 % (docs/evidence/oracles.md).
TEST_F(ValidateCli, ARoomAgreesWithItself) {
  const glm::dvec3 size(6.1, 3.0, 4.7);
  measure_box("room", "shoebox:6.1x3x4.7@0.25", size, 10, 411);
  const nlohmann::json mean =
      report_of("validate " + file("room") + " --scene shoebox:6.1x3x4.7@0.25 --preset balanced --seed 5 --plot " + file("room.svg"))
          .at("mean");
  EXPECT_LT(mean.at("t20_percent").at("error").get<double>(), 5);
  EXPECT_LT(std::abs(mean.at("t20_percent").at("bias").get<double>()), 2);
  EXPECT_LT(mean.at("drr_db").at("error").get<double>(), 0.8);
  EXPECT_LT(std::abs(mean.at("drr_db").at("bias").get<double>()), 0.3);
  EXPECT_LT(mean.at("c50_db").at("error").get<double>(), 0.8);
  EXPECT_LT(mean.at("decay_curve_db").at("error").get<double>(), 0.8);
  EXPECT_TRUE(mean.at("decay_curve_db").at("bias").is_null());
  EXPECT_EQ(mean.at("t20_percent").at("count"), 50);
  const std::string svg = read("room.svg");
  EXPECT_THAT(svg, testing::HasSubstr("r9.wav"));
  EXPECT_THAT(svg, testing::HasSubstr("decay time T20"));
}

// Another absorption: by Eyring's formula, the ratio of decay times is that of ln(1 - a), and DRR follows the reverberant energy.
TEST_F(ValidateCli, ShowsAWrongAbsorption) {
  const glm::dvec3 size(5.5, 3.2, 4.4);
  measure_box("room", "shoebox:5.5x3.2x4.4@0.2 --set air_absorption=off", size, 6, 412);
  const double expected = 100 * (std::log(1 - 0.2) / std::log(1 - 0.35) - 1);
  const nlohmann::json mean =
      report_of("validate " + file("room") + " --scene shoebox:5.5x3.2x4.4@0.35 --set air_absorption=off --preset balanced").at("mean");
  EXPECT_NEAR(mean.at("t20_percent").at("bias").get<double>(), expected, 5);
  EXPECT_GT(mean.at("drr_db").at("bias").get<double>(), 1.5);
}

// The same room at another scale of the samples, with noise behind the decay, an unknown delay, and its axes turned.
TEST_F(ValidateCli, TakesRecordsAsTheyCome) {
  const glm::dvec3 size(5.0, 3.0, 4.0);
  measure_box("room", "shoebox:5x3x4@0.3", size, 4, 413);
  std::string places = "scene: shoebox:5x3x4@0.3\nup: z\nresponses:\n";
  std::filesystem::create_directories(file("records"));
  for (int i = 0; i < 4; ++i) {
    const SoundChannels whole = load_sound_channels(file(fmt::format("room/r{}.wav", i)));
    std::vector<float> record(800 + static_cast<std::size_t>(37 * i), 0.f);
    float peak = 0;
    for (const float sample : whole.samples) peak = std::max(peak, std::abs(sample));
    for (const float sample : whole.samples) record.push_back(0.5f * sample / peak);
    const RandomStream random(414, Purpose::test, static_cast<std::uint32_t>(i));
    for (std::size_t n = 0; n < record.size(); ++n)
      record[n] += 2e-4f * static_cast<float>(random.normal2(static_cast<std::uint32_t>(n))[0]);
    write_wav(file(fmt::format("records/r{}.wav", i)), record, 1, 16000);
    const auto index = static_cast<std::uint32_t>(2 * i);
    const glm::dvec3 source = place_in_box(413, index, size), listener = place_in_box(413, index + 1, size);
    places += fmt::format("  - {{file: r{}.wav, source: [{:.4f}, {:.4f}, {:.4f}], listener: [{:.4f}, {:.4f}, {:.4f}]}}\n", i, source.x,
                          -source.z, source.y, listener.x, -listener.z, listener.y);
  }
  write("records/places.yaml", places);
  const nlohmann::json mean = report_of("validate " + file("records") + " --preset balanced").at("mean");
  EXPECT_LT(mean.at("t20_percent").at("error").get<double>(), 6);
  EXPECT_LT(mean.at("drr_db").at("error").get<double>(), 1);
}

TEST_F(ValidateCli, ReadsTheSofaFilesOfACorpus) {
  const CliOutcome corpus =
      earshot("dataset rir " + (source_dir() / "configs/datasets/rir.yaml").string() +
              " --sofa --set shoeboxes.count=1 --set scenes=[] --set seed=3 --set sources_per_room=2 --set listeners_per_source=4 --set "
              "channels=mono --set randomize=null --set source_patterns=[cardioid] --set acoustics.preset=balanced --out " +
              file("corpus"));
  if (corpus.exit_code == 2 && corpus.errors.find("HDF5") != std::string::npos) GTEST_SKIP() << "built without HDF5";
  ASSERT_EQ(corpus.exit_code, 0) << corpus.errors;
  const std::string manifest = read("corpus/manifest.jsonl");
  const nlohmann::json first = parse_json(manifest.substr(0, manifest.find('\n')));
  const std::string scene = first.at("scene");
  // One folder with the two files.
  std::filesystem::create_directories(file("sofa"));
  int files = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(file("corpus")))
    if (entry.path().extension() == ".sofa") std::filesystem::copy_file(entry.path(), file("sofa") / entry.path().filename()), ++files;
  ASSERT_EQ(files, 2);
  const nlohmann::json report = report_of("validate " + file("sofa") + " --scene '" + scene + "' --preset balanced");
  EXPECT_EQ(report.at("places").size(), 8u);
  EXPECT_LT(report.at("mean").at("t20_percent").at("error").get<double>(), 6);
  EXPECT_NEAR(report.at("places").at(0).at("distance_m").get<double>(), first.at("distance_m").get<double>(), 1e-3);
}

TEST_F(ValidateCli, RefusesWhatIsNoMeasuredRoom) {
  measure_box("room", "shoebox:5x3x4@0.3", {5, 3, 4}, 2, 415, "scene: shoebox:5x3x4@0.3\n");
  const std::string good = read("room/places.yaml");
  const auto refused = [&](const std::string& places, const std::string& part, const std::string& options = "") {
    write("room/places.yaml", places);
    expect_bad_input("validate " + file("room") + " " + options + " --json " + file("x.json"), part);
    EXPECT_FALSE(std::filesystem::exists(file("x.json"))) << part;
  };
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string changed = good;
    const std::size_t at = changed.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return changed.replace(at, from.size(), to);
  };
  refused(with("file: r0.wav", "file: r7.wav"), "r7.wav");
  refused(with("file: r1.wav", "file: r0.wav"), "twice");
  refused(with("file: r0.wav", "file: r0.wav, chanel: 0"), "chanel");
  refused(with("file: r0.wav", "file: r0.wav, channel: 1"), "has 1 channels");
  refused(with("file: r0.wav", "file: r0.wav, direct_delay_s: 9"), "lasts 1 s");
  refused(with("scene: shoebox:5x3x4@0.3\n", ""), "names no scene");
  refused("scene: shoebox:5x3x4@0.3\n", "names no responses");
  refused(with("source: [", "source: [1, "), "source");
  refused("up: x\n" + good, "up");
  refused("source_pattern: cardoid\n" + good, "cardoid");
  refused(with("source: [", "source: [100, 1, 1], sources: ["), "sources");
  refused(good, "glide_paths", "--set glide_paths=on");
  write("room/places.json", "{}");
  refused(good, "has both places.yaml and places.json");
  std::filesystem::remove(file("room/places.json"));
  write_wav(file("room/r0.wav"), std::vector<float>(16000, 0.f), 1, 16000);
  refused(good, "is silent");
  write_wav(file("room/r0.wav"), std::vector<float>(16000, 0.1f), 1, 8000);
  refused(good, "Hz, files before it have");
  std::filesystem::remove(file("room/places.yaml"));
  expect_bad_input("validate " + file("room"), "has no places.yaml");
  expect_bad_input("validate " + file("nowhere"), "no such folder");
  write("note.txt", "text");
  expect_bad_input("validate " + file("note.txt"), "neither a folder nor a SOFA file");
  write("damaged.sofa", "no HDF5 at all");
  expect_bad_input("validate " + file("damaged.sofa") + " --scene shoebox:5x3x4", "damaged.sofa");
}

}  // namespace
}  // namespace earshot
