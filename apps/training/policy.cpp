// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <array>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string_view>

#include "apps/commands.h"
#include "apps/options/output_options.h"
#include "policy/torch_threads.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "trainer/checkpoint/find_checkpoint.h"
#include "trainer/run/policy_file.h"

namespace earshot {
namespace {

struct PolicyArguments {
  std::string agent, out, json, module, run_config;
  std::vector<std::string> overrides;
  bool float16 = false, config = false;
};

bool is_zip(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::array<char, 2> start{};
  file.read(start.data(), start.size());
  return std::string_view(start.data(), start.size()) == "PK";
}

Checkpoint load_agent(const PolicyArguments& options, const std::filesystem::path& path) {
  if (!options.run_config.empty()) {
    use_one_torch_thread();
    return policy_of_module(load_run_config(options.run_config, options.overrides), options.agent);
  }
  if (std::error_code error; std::filesystem::is_regular_file(path, error) && is_zip(path))
    throw InputError(path.string(), "is a TorchScript module or another zip file, not an agent",
                     "to make a policy file of a module, name a run config with its sensors: --run-config FILE");
  return load_checkpoint(path);
}

void run_policy(const PolicyArguments& options) {
  if (options.float16 && options.out.empty()) throw InputError("--float16", "has no effect without --out", "name the file to write");
  const auto path = options.run_config.empty() ? find_checkpoint(options.agent) : std::filesystem::path(options.agent);
  const Checkpoint checkpoint = load_agent(options, path);
  if (options.config) {
    fmt::print("{}", checkpoint.config_yaml);
    return;
  }
  if (!options.module.empty()) {
    if (!checkpoint.module) throw InputError(path.string(), "has the built-in network, not a module", "leave out --module");
    write_file_atomically(options.module, *checkpoint.module);
  }
  if (!options.json.empty()) write_file_atomically(options.json, policy_json(checkpoint, path.string()));
  if (options.out.empty()) {
    fmt::print("{}", describe_policy(checkpoint, path.string()));
    return;
  }
  save_checkpoint(policy_of(checkpoint, options.float16 ? WeightStorage::float16 : WeightStorage::float32), options.out);
  fmt::print("{}  file          {:.2f} MB\n", describe_policy(load_checkpoint(options.out), options.out),
             static_cast<double>(std::filesystem::file_size(options.out)) / 1e6);
}

}  // namespace

void add_policy(CLI::App& app) {
  auto options = std::make_shared<PolicyArguments>();
  CLI::App* command = app.add_subcommand(
      "policy", "Describe a trained agent, export it without the training state, or make a policy file of a TorchScript module");
  command->add_option("AGENT", options->agent, "Policy file, checkpoint, run folder, or with --run-config a TorchScript module")
      ->required();
  auto* out =
      command->add_option("--out", options->out, "Policy file to write (weights and config) for 'earshot eval'")->type_name(kOutputFile);
  command->add_flag("--float16", options->float16, "Store weights as float16 (half the size, relative error at most 2^-11)");
  auto* module = command->add_option("--module", options->module, "Also write the TorchScript file of the agent's network (policy.module)")
                     ->type_name(kOutputFile);
  command->add_flag("--config", options->config, "Print the agent's config (YAML), a starting point for fine-tuning")
      ->excludes(out)
      ->excludes(module);
  auto* run_config = command->add_option(
      "--run-config", options->run_config,
      "Make a policy file of a TorchScript module; sensors and name come from this run config (docs/howto/own_network.md)");
  command->add_option("--set", options->overrides, "Override a key of --run-config: key=value; may be repeated")->needs(run_config);
  command->add_option("--json", options->json, "Also write the description to this JSON file")->type_name(kOutputFile);
  command->footer(
      "To fine-tune the agent, set `initial_policy: FILE` in a run config (configs/train/finetune.yaml, docs/explanation/agent.md).");
  command->callback([options] { run_policy(*options); });
}

}  // namespace earshot
