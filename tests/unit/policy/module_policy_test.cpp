// SPDX-License-Identifier: Apache-2.0
#include "policy/module_policy.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <string>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/random.h"
#include "tests/support/error_message.h"
#include "tests/support/files/test_paths.h"
#include "tests/support/workers/script_modules.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

constexpr int kModuleHidden = 8;

PolicyNetwork module_policy(const std::shared_ptr<const std::string>& file, const PolicyConfig& config = {}) {
  return std::make_shared<ModulePolicyImpl>(pointgoal_only(), config, file, "net.pt");
}

PolicyNetwork module_from(const std::string& source, const PolicyConfig& config = {}) {
  return module_policy(file_like(pointgoal_policy(kModuleHidden), source), config);
}

/// Why a module of this source is refused: one line that begins with its name.
std::string refusal_of(const std::string& source, const PolicyConfig& config = {}) {
  const std::string what = error_message([&] { module_from(source, config); });
  EXPECT_THAT(what, AllOf(testing::StartsWith("net.pt"), Not(HasSubstr("\n"))));
  return what;
}

std::string refusal_of_bytes(const std::string& bytes) {
  const std::string what = error_message([&] { module_policy(std::make_shared<const std::string>(bytes)); });
  EXPECT_THAT(what, AllOf(testing::StartsWith("net.pt"), Not(HasSubstr("\n"))));
  return what;
}

/// kGruSource with another line in the place of one of its own.
std::string with(const std::string& from, const std::string& to) {
  EXPECT_THAT(kGruSource, HasSubstr(from));
  return replaced(kGruSource, from, to);
}

struct Walk {
  ObservationTensors observations;
  torch::Tensor hidden, not_done;
};

/// T steps of B envs, of which some begin an episode.
Walk drawn_walk(std::int64_t T, std::int64_t B) {
  torch::manual_seed(4);
  Walk walk{
      {{"pointgoal", torch::randn({T * B, 2})}}, 0.3 * torch::randn({B, kModuleHidden}), (torch::rand({T, B}) > 0.3).to(torch::kFloat32)};
  return walk;
}

double largest_difference(const torch::Tensor& one, const torch::Tensor& other) { return (one - other).abs().max().item<double>(); }

TEST(ModulePolicy, HasTheLogitsAndGradientsOfTheBuiltInNetworkWithItsWeights) {
  ActorCritic built_in = pointgoal_policy(kModuleHidden);
  {
    const torch::NoGradGuard no_gradient;
    built_in->named_parameters()["actor.weight"].mul_(50);
  }
  const Walk walk = drawn_walk(7, 5);
  const PolicyOutput expected = built_in->sequence(walk.observations, walk.hidden, walk.not_done);
  (expected.logits.square().sum() + expected.value.sum()).backward();
  for (const std::string& source : {kGruSource, kGruSource + kGruSequence}) {
    const PolicyNetwork module = module_policy(file_like(built_in, source));
    ASSERT_EQ(module->hidden_size(), kModuleHidden);
    EXPECT_EQ(module->num_parameters(), built_in->num_parameters());
    const PolicyOutput output = module->sequence(walk.observations, walk.hidden, walk.not_done);
    EXPECT_LT(largest_difference(output.logits, expected.logits), 1e-6);
    EXPECT_LT(largest_difference(output.value, expected.value), 1e-6);
    EXPECT_LT(largest_difference(output.hidden, expected.hidden), 1e-6);
    (output.logits.square().sum() + output.value.sum()).backward();
    const auto named = module->named_parameters();
    for (const auto& item : built_in->named_parameters()) {
      const std::string name = "module." + replaced(replaced(item.key(), "rnn.", ""), ".", "_");
      EXPECT_LT(largest_difference(named[name].grad(), item.value().grad()), 1e-5) << name;
    }
  }
}

TEST(ModulePolicy, ForgetsWhateverTheStateHeldWhereAnEpisodeBegins) {
  const PolicyNetwork module = module_from(with("torch.zeros([%HIDDEN%])", "0.25 * torch.ones([%HIDDEN%])"));
  const Walk walk = drawn_walk(1, 3);
  torch::Tensor hidden = walk.hidden.clone();
  hidden[1].fill_(std::numeric_limits<float>::quiet_NaN());
  torch::Tensor not_done = torch::ones({3});
  not_done[1] = 0;
  const PolicyOutput output = module->step(walk.observations, hidden, not_done);
  ASSERT_TRUE(torch::isfinite(output.logits).all().item<bool>());
  // As from the initial state in the place of the old one.
  hidden[1].fill_(0.25);
  const PolicyOutput from_initial = module->step(walk.observations, hidden, torch::ones({3}));
  EXPECT_TRUE(torch::equal(output.logits, from_initial.logits));
  EXPECT_TRUE(torch::equal(output.hidden, from_initial.hidden));
}

TEST(ModulePolicy, StatesOfAnyShapeAndModulesWithoutStateWork) {
  const std::string in_rows = with("torch.zeros([%HIDDEN%])", "torch.zeros([2, 4])");
  const PolicyNetwork shaped =
      module_from(replaced(replaced(in_rows, "\"], state,", "\"], state.flatten(1),"), "value, after", "value, after.view(-1, 2, 4)"));
  EXPECT_EQ(shaped->hidden_size(), kModuleHidden);
  EXPECT_THAT(shaped->architecture(), HasSubstr("state 2x4"));
  const PolicyNetwork plain = module_from(kGruSource);
  const Walk walk = drawn_walk(4, 3);
  EXPECT_TRUE(torch::equal(shaped->sequence(walk.observations, walk.hidden, walk.not_done).logits,
                           plain->sequence(walk.observations, walk.hidden, walk.not_done).logits));

  const PolicyNetwork without = module_from(R"JIT(
def forward(self, observations: Dict[str, Tensor], state: Tensor) -> Tuple[Tensor, Tensor, Tensor]:
    rows = torch.matmul(observations["pointgoal"], self.weight_ih[:4].t())
    return rows, rows.sum(1), state
)JIT");
  EXPECT_EQ(without->hidden_size(), 1);
  const PolicyOutput output = without->sequence(walk.observations, torch::zeros({3, 1}), walk.not_done);
  EXPECT_EQ(output.logits.sizes(), (std::vector<std::int64_t>{12, 4}));
  EXPECT_EQ(output.hidden.sizes(), (std::vector<std::int64_t>{3, 1}));
}

TEST(ModulePolicy, KeysOfThePolicyMeanWhatTheyMeanForTheBuiltInNetwork) {
  const Walk walk = drawn_walk(3, 2);
  const PolicyNetwork plain = module_from(kGruSource);
  const PolicyOutput before = plain->sequence(walk.observations, walk.hidden, walk.not_done);
  PolicyConfig config;
  config.initial_stop_logit = -4;
  config.normalize_values = true;
  const PolicyNetwork module = module_from(kGruSource, config);
  PolicyOutput output = module->sequence(walk.observations, walk.hidden, walk.not_done);
  EXPECT_LT(largest_difference(output.logits, before.logits + torch::tensor({-4.f, 0.f, 0.f, 0.f})), 1e-6);
  EXPECT_LT(largest_difference(output.value, before.value), 1e-6);
  module->set_value_scale(3, 7);  // values stay what they were
  EXPECT_EQ(module->value_deviation(), 7);
  output = module->sequence(walk.observations, walk.hidden, walk.not_done);
  EXPECT_LT(largest_difference(output.value, before.value), 1e-5);

  config = {};
  config.recurrent = false;
  const PolicyOutput forgets = module_from(kGruSource, config)->sequence(walk.observations, walk.hidden, walk.not_done);
  const PolicyOutput each = plain->step(walk.observations, torch::zeros({6, kModuleHidden}), torch::zeros({6}));
  EXPECT_LT(largest_difference(forgets.logits, each.logits), 1e-6);
}

TEST(ModulePolicy, NamesTheTensorAndTheShapeThatDoesNotFit) {
  EXPECT_THAT(refusal_of(with("return logits,", "return logits[:, :3],")),
              AllOf(HasSubstr("action logits of the shape 6x3"), HasSubstr("6x4")));
  EXPECT_THAT(refusal_of(with("value, after", "value.expand(-1, 2), after")),
              AllOf(HasSubstr("value of the shape 6x2"), HasSubstr("needed is 6")));
  EXPECT_THAT(refusal_of(with("value, after", "value, after[:, :5]")), AllOf(HasSubstr("state of the shape 6x5"), HasSubstr("6x8")));
  EXPECT_THAT(refusal_of(with("return logits,", "return logits.double(),")),
              AllOf(HasSubstr("action logits as Double"), HasSubstr("Float")));
  EXPECT_THAT(refusal_of(with("torch.zeros([%HIDDEN%])", "torch.zeros([5])")), AllOf(HasSubstr("forward fails"), HasSubstr("state Nx5")));
  EXPECT_THAT(refusal_of(with("torch.zeros([%HIDDEN%])", "torch.zeros([8], dtype=4)")), HasSubstr("initial_state returns 8 of Long"));
  EXPECT_THAT(refusal_of(with("[\"pointgoal\"]", "[\"depth\"]")),
              AllOf(HasSubstr("the observation 'depth', which is not on"), HasSubstr("pointgoal Nx2")));
  EXPECT_THAT(refusal_of(with("observations[\"pointgoal\"]", "observations[\"pointgoal\"][:, :1]")), HasSubstr("forward fails"));
  PolicyConfig config;
  config.goal_heads = true;
  EXPECT_THAT(refusal_of(kGruSource, config),
              AllOf(HasSubstr("returns 3 tensors"), HasSubstr("needed are 4"), HasSubstr("policy.goal_heads")));
  const std::string one = replaced(with("Tuple[Tensor, Tensor, Tensor]", "Tensor"), "return logits, value, after", "return logits");
  EXPECT_THAT(refusal_of(one), HasSubstr("does not return a tuple"));
  EXPECT_THAT(refusal_of("def other(self, x: Tensor) -> Tensor:\n    return x\n"), HasSubstr("no method forward"));
}

TEST(ModulePolicy, RefusesWhatPpoCannotLearnFrom) {
  EXPECT_THAT(refusal_of(with("value, after", "value, after - after.mean(0)")), HasSubstr("a row alone"));
  EXPECT_THAT(refusal_of(with("return logits,", "return logits / 0,")), HasSubstr("not finite"));
  EXPECT_THAT(refusal_of(with("return logits,", "return logits + torch.rand_like(logits),")),
              AllOf(HasSubstr("aten::rand_like"), HasSubstr("random")));
  EXPECT_THAT(refusal_of(with("return logits,", "print(logits)\n    return logits,")),
              AllOf(HasSubstr("prim::Print"), HasSubstr("prints")));
  EXPECT_THAT(refusal_of(with("return logits,", "return logits.detach(),")), HasSubstr("action logits that no parameter has a part in"));
  EXPECT_THAT(refusal_of(with("value, after", "value.detach(), after")), HasSubstr("a value that no parameter has a part in"));
  EXPECT_THAT(refusal_of(kGruSource + replaced(kGruSequence, "torch.zeros_like(state), state)", "state, state)")),
              HasSubstr("from sequence"));
  EXPECT_THAT(refusal_of(kGruSource + replaced(kGruSequence, "torch.stack(logits)", "torch.stack(logits).transpose(0, 1)")),
              AllOf(HasSubstr("sequence returns action logits"), HasSubstr("2x3x4"), HasSubstr("3x2x4")));
}

TEST(ModulePolicy, RefusesBuffersThatChangeAndWeightsOfOtherTypes) {
  const ActorCritic network = pointgoal_policy(kModuleHidden);
  torch::jit::Module counts = module_like(network, "");
  counts.register_buffer("calls", torch::zeros({1}));
  counts.define(replaced(with("return logits,", "self.calls.add_(1)\n    return logits,"), "%HIDDEN%", "8"));
  EXPECT_THAT(refusal_of_bytes(bytes_of(counts)), HasSubstr("changes its buffer 'module.calls'"));

  torch::jit::Module doubles = module_like(network, kGruSource);
  doubles.setattr("actor_bias", torch::zeros({4}, torch::kFloat64));
  EXPECT_THAT(refusal_of_bytes(bytes_of(doubles)), AllOf(HasSubstr("parameter 'actor_bias' is Double"), HasSubstr("float32")));

  torch::jit::Module frozen = module_like(network, kGruSource);
  for (const auto& item : frozen.named_parameters()) item.value.requires_grad_(false);
  EXPECT_THAT(refusal_of_bytes(bytes_of(frozen)), HasSubstr("no parameters that train"));
}

TEST(ModulePolicy, TiedWeightsStayOneTensor) {
  torch::jit::Module tied("Net");
  const torch::Tensor weight = torch::randn({4, 2});
  for (const char* name : {"first", "second"}) tied.register_parameter(name, weight, false);
  tied.define(R"JIT(
def forward(self, observations: Dict[str, Tensor], state: Tensor) -> Tuple[Tensor, Tensor, Tensor]:
    rows = torch.matmul(observations["pointgoal"], self.first.t())
    return rows, torch.matmul(observations["pointgoal"], self.second.t()).sum(1), state
)JIT");
  weight.requires_grad_(true);
  const PolicyNetwork policy = module_policy(std::make_shared<const std::string>(bytes_of(tied)));
  ASSERT_EQ(policy->parameters().size(), 1U);
  const ObservationTensors seen{{"pointgoal", torch::ones({1, 2})}};
  const torch::Tensor before = policy->step(seen, torch::zeros({1, 1}), torch::ones({1})).value;
  {
    const torch::NoGradGuard no_gradient;
    policy->parameters()[0].add_(1);
  }
  EXPECT_NEAR(largest_difference(policy->step(seen, torch::zeros({1, 1}), torch::ones({1})).value, before), 8, 1e-5);
}

TEST(ModulePolicy, GarbageAndFilesCutAnywhereAreRefusedInOneLine) {
  EXPECT_THAT(refusal_of_bytes(""), HasSubstr("not a TorchScript file"));
  EXPECT_THAT(refusal_of_bytes("not a zip file"), HasSubstr("not a TorchScript file"));
  const std::string whole = *file_like(pointgoal_policy(kModuleHidden), kGruSource);
  const RandomStream random(7, Purpose::weights, 1);
  for (std::uint32_t draw = 0; draw < 40; ++draw) {
    const auto cut = random.below(draw, static_cast<std::uint32_t>(whole.size()));
    EXPECT_NE(refusal_of_bytes(whole.substr(0, cut)), "no error") << cut;
  }
  EXPECT_THAT(refusal_of_bytes(whole.substr(0, whole.size() / 2)), HasSubstr("cannot be read as TorchScript"));
}

/// A file of tests/unit/policy/unknown_operator.py.
TEST(ModulePolicy, NamesTheOperatorThatThisLibtorchLacks) {
  const std::string bytes = read_file(source_dir() / "tests/unit/policy/unknown_operator.pt");
  EXPECT_THAT(refusal_of_bytes(bytes), AllOf(HasSubstr("uses aten::of_a_later_version, which libtorch"), HasSubstr("does not have")));
}

TEST(ModulePolicy, ArchitectureTellsFilesAndKeysApart) {
  const std::string line = module_from(kGruSource)->architecture();
  EXPECT_THAT(line, AllOf(testing::StartsWith("module v1 "), HasSubstr("pointgoal 2"), HasSubstr("state 8")));
  EXPECT_NE(line, module_from(kGruSource + kGruSequence)->architecture());
  PolicyConfig config;
  config.initial_stop_logit = -1;
  EXPECT_NE(line, module_from(kGruSource, config)->architecture());
  EXPECT_EQ(line, module_from(kGruSource)->architecture());
}

}  // namespace
}  // namespace earshot
