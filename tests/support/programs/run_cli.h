// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <memory>
#include <msgpack.hpp>
#include <string>
#include <vector>

#include "sim/base/files.h"
#include "tests/support/programs/background_program.h"
#include "tests/support/programs/train_cli.h"
#include "trainer/checkpoint/checkpoint_format.h"

namespace earshot {

/// Runs of `earshot train` that go on beside the test, and what they leave.
class RunCli : public TrainCli {
 protected:
  void SetUp() override { expect_done("dataset episodes --config " + config_); }
  /// A new run into a folder that is not there, unless `words` go on with one.
  [[nodiscard]] std::unique_ptr<BackgroundProgram> start(const std::vector<std::string>& words, const std::string& output = "first") const {
    if (std::ranges::find(words, "--resume") == words.end()) std::filesystem::remove_all(path("run"));
    std::vector<std::string> line{"train", config_};
    line.insert(line.end(), words.begin(), words.end());
    return std::make_unique<BackgroundProgram>(line, path(output));
  }
  /// Until its first checkpoint is there.
  [[nodiscard]] bool is_under_way(const std::string& run = "run") const {
    return BackgroundProgram::wait_for(path(run + "/checkpoints/update_000001.ckpt"));
  }
  /// Hash of weights and optimizer in a checkpoint.
  [[nodiscard]] std::uint64_t bits_of(const std::string& file) const {
    const std::string where = path(file), bytes = read_file(where);
    const msgpack::object_handle body = unpack_checkpoint(bytes, where);
    msgpack::sbuffer learned;
    for (const char* field : {"weights", "optimizer"}) msgpack::pack(learned, CheckpointFields(where).field(body.get(), field));
    return hash64(std::string_view(learned.data(), learned.size()));
  }
  [[nodiscard]] std::uint64_t update_of(const std::string& file) const { return load_checkpoint_metadata(path(file)).update; }
  /// The newest whole checkpoint of a run.
  [[nodiscard]] std::uint64_t newest_update(const std::string& run = "run") const {
    return load_checkpoint_metadata(find_checkpoint(path(run))).update;
  }
  const std::string config_ = path("tiny.yaml");
};

}  // namespace earshot
