// SPDX-License-Identifier: Apache-2.0
// A run goes on only with the sounds, the head, the microphones and the scenes that it began with.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <vector>

#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/base/files.h"
#include "tests/support/files/drawn_room.h"
#include "tests/support/programs/train_cli.h"
#if __has_include(<hdf5.h>)
#include "tests/support/files/made_head.h"
#endif

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;

class ChangedInputsCli : public TrainCli {
 protected:
  /// The parameter tells two contents of a file apart.
  void write_tone(double frequency_hz) const {
    std::vector<float> samples(8000);
    for (std::size_t n = 0; n < samples.size(); ++n)
      samples[n] = static_cast<float>(0.4 * std::sin(0.0004 * frequency_hz * static_cast<double>(n)));
    write_wav(path("tone.wav"), samples, 1, 16000);
  }
  void write_room(double height_m) const {
    DrawnRoom room(5);
    room.size = {6, height_m, 5};
    room.lower = {0, 0, 0};
    room.unit_m = 1;
    room.is_z_up = false;
    write_text(path("room.obj"), room.obj({"wall", "wall", "floor", "ceiling", "wall", "wall"}));
  }
#if __has_include(<hdf5.h>)
  void write_head(double early_samples) const {
    MadeHead head{.early_samples = early_samples};
    head.add_sphere(50, 1.5, 0.5);
    write_text(path("head.sofa"), head.bytes());
  }
#endif
  void write_array(double offset_m) const {
    write_text(path("array.json"),
               fmt::format(R"({{"microphones": [{{"position_m": [0, 0, 0]}}, {{"position_m": [{}, 0, 0]}}]}})", offset_m));
  }
  void begin(const std::string& ears) {
    write_tone(440);
    write_room(3);
    const std::string text = read_file(path("tiny.yaml"));
    std::string config = text;
    const auto replace = [&](const std::string& from, const std::string& to) {
      for (std::size_t at = 0; (at = config.find(from, at)) != std::string::npos; at += to.size()) config.replace(at, from.size(), to);
    };
    replace("shoebox:6x3x5@0.3", path("room.obj"));
    replace("synth:noise", path("tone.wav"));
    write_text(path("tiny.yaml"), config);
    train_ = "train " + path("tiny.yaml") + " env.acoustics.field=off " + ears;
    expect_done("dataset episodes --config " + path("tiny.yaml"));
    expect_done(train_ + " total_steps=16");
  }
  /// Resuming is refused while `name` has other bytes, and goes on when it has the old ones.
  void expect_guarded(const std::string& name, const std::function<void()>& change) {
    const std::string before = read_file(path(name));
    change();
    ASSERT_NE(read_file(path(name)), before);
    for (const char* workers : {"", " --workers 1"})
      expect_refused(train_ + " --resume " + path("run") + workers,
                     AllOf(HasSubstr(path(name) + ": has changed since"), HasSubstr("restore")));
    write_text(path(name), before);
  }

  std::string train_;
};

TEST_F(ChangedInputsCli, ARunWithMicrophonesIsResumedWithItsFilesOnly) {
  write_array(0.1);
  begin("env.observation.channels=array:" + path("array.json"));
  expect_guarded("array.json", [&] { write_array(0.11); });
  expect_guarded("tone.wav", [&] { write_tone(441); });
  expect_done(train_ + " --resume " + path("run"));
}

#if __has_include(<hdf5.h>)
TEST_F(ChangedInputsCli, ARunWithAHeadIsResumedWithItsFilesOnly) {
  write_head(12);
  begin("env.hrtf=" + path("head.sofa"));
  expect_guarded("head.sofa", [&] { write_head(13); });
  expect_guarded("tone.wav", [&] { write_tone(441); });
  expect_guarded("room.obj", [&] { write_room(3.01); });
  expect_done(train_ + " --resume " + path("run"));
}

// Declared, another head is taken.
TEST_F(ChangedInputsCli, AnotherHeadByItsOwnNameIsAChangeOfTheConfig) {
  write_head(12);
  begin("env.hrtf=" + path("head.sofa"));
  write_text(path("other.sofa"), read_file(path("head.sofa")));
  const std::string other = "train " + path("tiny.yaml") + " env.hrtf=" + path("other.sofa") + " --resume " + path("run");
  expect_refused(other, HasSubstr("env.hrtf"));
  expect_done(other + " --change env.hrtf");
}
#endif

}  // namespace
}  // namespace earshot
