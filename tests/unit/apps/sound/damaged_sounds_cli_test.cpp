// SPDX-License-Identifier: Apache-2.0
// Commands that read sound: a damaged file ends each with exit code 2 and one line that names it.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "sim/audio/dry_sounds/flac_bytes.h"
#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/base/files.h"
#include "sim/base/random.h"
#include "tests/support/files/test_data.h"
#include "tests/support/programs/cli.h"

namespace earshot {
namespace {

class DamagedSoundsCli : public Cli {
 protected:
  void SetUp() override {
    Cli::SetUp();
    write("rir.yaml",
          "seed: 3\nshoeboxes: {count: 1, max_size_m: [5, 3, 5]}\nsources_per_room: 1\nlisteners_per_source: 1\n"
          "acoustics: {rays: 16, rir_length_s: 0.2}\n");
    write("poses.csv", "0,1,1.5,1,0\n0.3,1,1.5,2,90\n");
    ASSERT_EQ(earshot("dataset rir " + file("rir.yaml") + " --out " + file("corpus")).exit_code, 0);
    for (const char* folder : {"speech", "noise", "damaged"}) std::filesystem::create_directory(file(folder));
    const SoundClip clip = synthesize_sound("synth:noise", 16000);
    write_wav(file("speech/whole.wav"), clip.samples, 1, 16000);
    flac_ = flac_bytes(clip.samples, 1, 16000);
  }

  static constexpr std::uint32_t kNumCommands = 4;
  /// Runs a command that reads sound with a damaged file, which is the only one in its folder.
  void expect_refused(std::uint32_t command, const std::string& bytes, const std::string& name) const {
    const std::string damaged = write("damaged/" + name, bytes), convolve = "dataset convolve " + file("corpus") + " --count 1 --speech ";
    write("scenes.yaml",
          "seed: 1\nshoeboxes: {count: 1, min_size_m: [3, 3, 3], max_size_m: [5, 3, 5]}\nrecordings_per_room: 1\nduration_s: 2\n"
          "event_s: [0.5, 1]\nchannels: ambisonic:1:sn3d:ego\nacoustics: {rays: 16, rir_length_s: 0.2}\nclasses: {hum: " +
              damaged + "}\n");
    const std::string commands[kNumCommands] = {
        convolve + file("damaged"), convolve + file("speech") + " --noise " + file("damaged"),
        "walk shoebox:5x3x4@0.3 --set rays=16 --source 4,1.5,1 --poses " + file("poses.csv") + " --sound " + damaged,
        "dataset scenes " + file("scenes.yaml")};
    expect_bad_input(commands[command] + " --out " + file("out.wav"), damaged);
    std::filesystem::remove(damaged);
    std::filesystem::remove_all(file("out.wav"));
  }

  std::string flac_;
};

TEST_F(DamagedSoundsCli, EveryCommandNamesACutOrFlippedFile) {
  const RandomStream random(3, Purpose::test);
  const std::string wav = read("speech/whole.wav");
  const auto below = [&](const std::string& bytes, std::uint32_t draw) {  // behind the heads
    return 100 + random.below(static_cast<std::uint32_t>(bytes.size() - 100), draw);
  };
  for (std::uint32_t trial = 0; trial < 12; ++trial) {
    std::string flipped = flac_;
    const std::size_t place = flac_.size() / 2 + below(flac_, trial) / 2 - 50;
    flipped[place] = static_cast<char>(flipped[place] ^ 8);
    const std::string damaged[3] = {wav.substr(0, below(wav, trial)), flac_.substr(0, below(flac_, trial)), flipped};
    const char* const names[3] = {"cut.wav", "cut.flac", "flipped.flac"};
    expect_refused(trial % kNumCommands, damaged[trial % 3], names[trial % 3]);
  }
}

// A measured response, or one of Earshot's own, is a sound file as well.
TEST_F(DamagedSoundsCli, ACutResponseIsRefused) {
  std::string path;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(file("corpus")))
    if (entry.path().extension() == ".wav") path = entry.path().string();
  ASSERT_FALSE(path.empty());
  const std::string bytes = read_file(path);
  write_file_atomically(path, bytes.substr(0, bytes.size() / 2));
  expect_bad_input("dataset convolve " + file("corpus") + " --speech " + file("speech") + " --out " + file("a"), path);
}

TEST_F(DamagedSoundsCli, TheGivenFilesAreRefused) {
  SKIP_WITHOUT_DATA("field");
  for (std::uint32_t command = 0; command < kNumCommands; ++command) {
    expect_refused(command, read_file(data_folder() / "field/sound_cut_flac/a.flac"), "a.flac");
    expect_refused(command, read_file(data_folder() / "field/sound_cut_wav/cut.wav"), "cut.wav");
  }
}

}  // namespace
}  // namespace earshot
