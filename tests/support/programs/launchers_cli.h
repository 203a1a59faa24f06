// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdlib>
#include <string>

#include "sim/base/files.h"
#include "tests/support/programs/train_cli.h"
#include "trainer/checkpoint/checkpoint_format.h"

namespace earshot {

/// A training of seconds, started by the scripts of configs/launch.
class LaunchersCli : public TrainCli {
 protected:
  LaunchersCli() {
    ::setenv("EARSHOT", earshot_program().c_str(), 1);
    for (const char* name : {"OMPI_ALLOW_RUN_AS_ROOT", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM"}) ::setenv(name, "1", 1);
  }
  void SetUp() override { expect_done("dataset episodes --config " + config_); }
  [[nodiscard]] static std::string launch(const std::string& name) { return source_dir() / "configs" / "launch" / name; }
  /// Runs a shell command; its output and errors together.
  [[nodiscard]] Outcome shell(const std::string& command) const {
    const int status = std::system(("{ " + command + "; } >" + path("output") + " 2>&1 </dev/null").c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, read_file(path("output"))};
  }
  void expect_done_by(const std::string& command) const {
    const Outcome outcome = shell(command);
    EXPECT_EQ(outcome.exit_code, 0) << command << "\n" << outcome.text;
  }
  /// Hash of the weights and of what the optimizer knows at the end of the run in that folder.
  [[nodiscard]] std::uint64_t bits_of(const std::string& run) const {
    const std::string where = path(run + "/checkpoints/last.ckpt"), file = read_file(where);
    const msgpack::object_handle body = unpack_checkpoint(file, where);
    msgpack::sbuffer bytes;
    for (const char* field : {"weights", "optimizer"}) msgpack::pack(bytes, CheckpointFields(where).field(body.get(), field));
    return hash64(std::string_view(bytes.data(), bytes.size()));
  }
  [[nodiscard]] std::uint64_t bits_of_our_spawn(const std::string& options = "") const {
    expect_done("train " + config_ + " --workers 2 out=" + path("ours") + options);
    return bits_of("ours");
  }
  const std::string config_ = path("tiny.yaml");
};

}  // namespace earshot
