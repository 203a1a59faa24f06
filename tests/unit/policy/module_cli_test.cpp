// SPDX-License-Identifier: Apache-2.0
// A module is trained, resumed, evaluated and exported by the commands that a user types.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>

#include "evaluation/results/result.h"
#include "sim/base/files.h"
#include "tests/support/programs/board_rules_cli.h"
#include "tests/support/workers/script_modules.h"
#include "trainer/checkpoint/checkpoint.h"
#include "trainer/curves/event_log.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::AnyOf;
using testing::HasSubstr;

constexpr int kCliHidden = 8;

class ModuleCli : public BoardRulesCli {
 protected:
  ModuleCli() { write("net.pt", kHearingSource); }
  void write(const std::string& name, const std::string& source) const {
    write_file_atomically(path(name), *file_like(pointgoal_policy(kCliHidden), source));
  }
  [[nodiscard]] std::string train(const std::string& rest) const {
    return "train " + config_ + " policy.module=" + path("net.pt") + " " + rest;
  }
  [[nodiscard]] Checkpoint last(const std::string& run = "run") const { return load_checkpoint(path(run + "/checkpoints/last.ckpt")); }
  /// The policy file with another module in it.
  void change_module(const std::string& file, const std::string& bytes, const std::string& out) const {
    Checkpoint checkpoint = load_checkpoint(file);
    checkpoint.module = std::make_shared<const std::string>(bytes);
    save_checkpoint(checkpoint, path(out));
  }

  std::string config_ = path("tiny.yaml");
};

TEST_F(ModuleCli, TrainsResumesBitForBitEvaluatesAndExports) {
  expect_done(train("total_steps=32"));
  const Checkpoint whole = last();
  ASSERT_TRUE(whole.module);
  EXPECT_EQ(*whole.module, read_file(path("net.pt")));
  EXPECT_THAT(whole.architecture, testing::StartsWith("module v1 "));

  expect_done(train("total_steps=16 --overwrite"));
  EXPECT_NE(hash_of(last().weights), hash_of(whole.weights));
  expect_done(train("total_steps=32 --resume " + path("run")));
  const Checkpoint resumed = last();
  EXPECT_EQ(hash_of(resumed.weights), hash_of(whole.weights));
  EXPECT_EQ(hash_of(resumed.optimizer), hash_of(whole.optimizer));
  EXPECT_EQ(resumed.env_states, whole.env_states);

  // What is evaluated has the module in itself.
  const std::string file = path("x.policy");
  expect_done("policy " + path("run") + " --out " + file + " --module " + path("again.pt"));
  EXPECT_EQ(read_file(path("again.pt")), read_file(path("net.pt")));
  std::filesystem::rename(path("net.pt"), path("moved.pt"));
  expect_done("eval " + file + " --episodes " + path("eval.json.gz") + " --argmax --out " + path("result.json"));
  EXPECT_THAT(read_file(path("result.json")), HasSubstr("policy_hash"));

  // Another module is another network; the same one under another name is not.
  write("net.pt", kHearingSource + "\ndef unused(self) -> int:\n    return 1\n");
  expect_refused(train("total_steps=48 --resume " + path("run")), AllOf(HasSubstr("architecture"), HasSubstr("module v1")));
  expect_done("train " + config_ + " policy.module=" + path("moved.pt") + " total_steps=48 --resume " + path("run"));
}

TEST_F(ModuleCli, RefusesAModuleThatDoesNotFitBeforeAnythingIsWritten) {
  expect_refused("train " + config_ + " policy.module=" + path("none.pt"), AllOf(HasSubstr("none.pt"), HasSubstr("does not exist")));
  expect_refused("train " + config_ + " policy.module=" + path("tiny.yaml"), HasSubstr("not a TorchScript file"));
  write("net.pt", kGruSource);
  expect_refused(train(""), AllOf(HasSubstr("net.pt"), HasSubstr("'pointgoal', which is not on"), HasSubstr("spectrogram Nx65x26x2")));
  EXPECT_FALSE(std::filesystem::exists(path("run/checkpoints")));
}

// The evaluations of a run have the numbers of `eval`, and go on with a resumed run.
TEST_F(ModuleCli, IsEvaluatedOnHeldOutEpisodesWhileItTrains) {
  write_text(config_, read_file(config_) + "  held_out: {file: " + path("held_out.json.gz") +
                          ", scenes: [\"shoebox:7x3x4@0.3\", \"shoebox:4x3x7@0.3\"], episodes_per_scene: 4, sounds: [\"synth:noise\"], "
                          "filter: {min_geodesic_m: 1, min_ratio: 1}}\nheld_out: {every_updates: 1, max_fraction: 1}\n");
  expect_done("dataset episodes --config " + config_);
  const std::string keys = "ppo.learning_rate=0.02 --workers 2 ";
  const auto state_of = [&](const std::string& run) {
    HeldOutState state = last(run).held_out.value_or(HeldOutState{});
    state.seconds = state.last_seconds = 0;  // of this machine
    return state;
  };
  expect_done(train(keys + "total_steps=64 out=" + path("whole")));
  expect_done(train(keys + "total_steps=32 out=" + path("broken")));
  expect_done(train(keys + "total_steps=64 out=" + path("broken") + " --resume " + path("broken")));
  EXPECT_EQ(hash_of(last("broken").weights), hash_of(last("whole").weights));
  EXPECT_EQ(state_of("broken"), state_of("whole"));

  std::map<std::uint64_t, std::map<std::string, double>> curve;
  for (const CurvePoint& point : read_event_log(path("whole/events.jsonl")))
    if (is_of_held_out(point)) curve[point.update] = {point.values.begin(), point.values.end()};
  EXPECT_EQ(curve.size(), 4U);
  const std::string best = path("whole/checkpoints/best.ckpt");
  const auto& values = curve.at(load_checkpoint(best).update);
  for (const std::string how : {"argmax", "sample"}) {
    expect_done("eval " + best + " --episodes " + path("held_out.json.gz") + " --" + how + " --out " + path("result.json"));
    const EvaluationResult result = load_result(path("result.json"));
    EXPECT_EQ(values.at("held_out/" + how + "_success"), result.success().mean);
    EXPECT_EQ(values.at("held_out/" + how + "_spl"), result.spl().mean);
  }
}

// A benchmark runs it in a process of its own, which has no file of the author's.
TEST_F(ModuleCli, ABenchmarkHasTheBitsOfOneProcess) {
  const std::string file = policy("module", "policy.module=" + path("net.pt"));
  std::filesystem::remove(path("net.pt"));
  expect_bits_of_one_process(file);
  expect_done("verify " + path("apart.json") + board());
}

// What another trainer wrote gets onto the board by its module and the sensors that it reads.
TEST_F(ModuleCli, AModuleOfAnotherTrainerIsEvaluatedVerifiedAndRanked) {
  const std::string file = path("other.policy"), out = " --out " + file;
  expect_refused("policy " + path("net.pt"), AllOf(HasSubstr("net.pt"), HasSubstr("TorchScript module"), HasSubstr("--run-config FILE")));
  expect_refused("policy " + path("none.pt") + " --run-config " + config_ + out, AllOf(HasSubstr("none.pt"), HasSubstr("does not exist")));
  EXPECT_FALSE(std::filesystem::exists(file));
  expect_done("policy " + path("net.pt") + " --run-config " + config_ + " --set name=other --set policy.initial_stop_logit=-4" + out);
  const Checkpoint made = load_checkpoint(file);
  ASSERT_TRUE(made.module && made.is_policy);
  EXPECT_EQ(*made.module, read_file(path("net.pt")));
  // The weights of the file, to which nothing of the config has been added.
  const ActorCritic written = pointgoal_policy(kCliHidden);
  for (const auto& item : written->named_parameters()) {
    const std::string name = "module." + replaced(replaced(item.key(), "rnn.", ""), ".", "_");
    ASSERT_TRUE(made.weights.contains(name)) << name;
    EXPECT_TRUE(torch::equal(made.weights.at(name), item.value())) << name;
  }
  EXPECT_EQ(made.architecture.find("stop"), std::string::npos);

  std::filesystem::remove(path("net.pt"));
  expect_done("eval " + file + board() + " --argmax --out " + path("other.json"));
  expect_done("verify " + path("other.json") + board());
  expect_done("leaderboard " + path("other.json") + board() + " --json " + path("rows.json"));
  EXPECT_THAT(read_file(path("rows.json")), AllOf(HasSubstr("\"other\""), HasSubstr("run by the board")));
}

TEST_F(ModuleCli, ABenchmarkRefusesOrEndsAModuleThatMisbehaves) {
  const std::string file = policy("module", "policy.module=" + path("net.pt"));
  const auto with_line = [&](const std::string& line) {
    return *file_like(pointgoal_policy(kCliHidden), replaced(kHearingSource, "    after =", "    " + line + "\n    after ="));
  };
  const auto expect_ended = [&](const std::string& bytes, const std::string& options, const testing::Matcher<std::string>& line) {
    change_module(file, bytes, "bad.policy");
    expect_refused("eval " + path("bad.policy") + board() + options + " --out " + path("none.json"),
                   AllOf(testing::StartsWith("earshot: " + path("bad.policy")), line));
    EXPECT_FALSE(std::filesystem::exists(path("none.json")));
  };
  expect_ended(with_line("print(state)"), "", HasSubstr("bad.policy (its module): uses the operator prim::Print, which prints"));
  expect_ended(with_line("state = torch.from_file(\"/etc/passwd\", False, 8)"), "", HasSubstr("aten::from_file, which opens a file"));
  expect_ended(with_line("state = state + torch.zeros([274877906944])"), "", HasSubstr("needs more than 4096 MB of memory"));
  expect_ended(with_line("kept = [state]\n    while len(kept) > 0:\n        kept.append(torch.ones([4194304]))"),
               " --policy-memory-gb 0.25", HasSubstr("needs more than 256 MB of memory"));
  expect_ended(with_line("while state.numel() > 0:\n        state = state + 0"), " --policy-seconds 6",
               AnyOf(HasSubstr("did not answer within 6 s"), HasSubstr("takes more than 6 s of CPU time")));
  const std::string whole = read_file(path("net.pt"));
  expect_ended(whole.substr(0, whole.size() / 2), "", HasSubstr("cannot be read as TorchScript"));
  // Another network than its weights are of.
  expect_ended(with_line("state = state + 0"), "", HasSubstr("architecture"));
}

}  // namespace
}  // namespace earshot
