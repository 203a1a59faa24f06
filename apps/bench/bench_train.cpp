// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "apps/commands.h"
#include "apps/options/output_options.h"
#include "bench/accuracy/engine_process.h"
#include "bench/measure/bench_report.h"
#include "bench/measure/bench_scene.h"
#include "bench/training/learner_speed.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/temporary_folder.h"
#include "sim/base/text/json.h"

namespace earshot {
namespace {

struct BenchTrainArguments {
  std::string config, json, python;
  std::vector<std::string> overrides;
  double seconds = 3;
  int repeats = 5;
  bool quick = false, no_torch = false, no_training = false;
};

struct Answer {
  int code = -1;
  std::string text;  ///< standard output
};

Answer run_shell(const std::string& command) {
  Answer answer;
  std::FILE* pipe = popen(command.c_str(), "r");
  if (pipe == nullptr) return answer;
  std::array<char, 4096> block{};
  while (const std::size_t count = std::fread(block.data(), 1, block.size(), pipe)) answer.text.append(block.data(), count);
  const int status = pclose(pipe);
  if (WIFEXITED(status)) answer.code = WEXITSTATUS(status);
  return answer;
}

/// The first of the usual interpreters, or the named one, that can import torch; empty if none can.
std::optional<std::string> python_with_torch(const BenchTrainArguments& options) {
  const std::vector<std::string> candidates =
      options.python.empty() ? std::vector<std::string>{"python3", "/usr/bin/python3"} : std::vector<std::string>{options.python};
  for (const std::string& python : candidates)
    if (run_shell(shell_quoted(python) + " -c 'import torch' 2>/dev/null").code == 0) return python;
  return std::nullopt;
}

std::string torch_script() {
  if (const auto script = source_file("scripts/bench_learner_torch.py")) return *script;
  throw InputError("scripts/bench_learner_torch.py", "was not found in the source folder of this program", "skip torch with --no-torch");
}

/// One process of torch: its samples per second, by processor time and by the wall, and its version.
nlohmann::json ask_torch(const std::string& python, const std::string& script, const std::string& request) {
  const Answer answer = run_shell(shell_quoted(python) + " " + shell_quoted(script) + " " + shell_quoted(request));
  const nlohmann::json result = parse_json_or_discard(answer.text);
  if (answer.code != 0 || !result.is_object() || !result.contains("samples_per_cpu_s") || !result["samples_per_cpu_s"].is_number() ||
      !result.contains("samples_per_s") || !result["samples_per_s"].is_number())
    throw RunError(script, fmt::format("failed with exit code {}; skip it with --no-torch", answer.code));
  return result;
}

void add_training(const RunConfig& config, const BenchTrainArguments& options, const std::filesystem::path& folder,
                  const BenchJson& setting, BenchReport& report) {
  const TrainingSpeed speed = measure_training(config, options.quick ? 0.1 : 5 * options.seconds, folder.string());
  const auto single_value = [](double value) { return Measured{value, value, value}; };
  const double steps = static_cast<double>(speed.steps);
  report.add("train.steps_per_s", "1/s", single_value(steps / speed.wall_s), setting);
  const StageTimes& s = speed.stages;
  const std::array<std::pair<const char*, double>, 6> stages{{{"sound", s.simulate_sound},
                                                              {"convolve", s.convolve},
                                                              {"render", s.render},
                                                              {"move", s.move},
                                                              {"policy", s.policy},
                                                              {"learn", s.learn + s.reduce}}};
  for (const auto& [name, seconds] : stages)
    report.add(fmt::format("train.stage_ms.{}", name), "ms per step", single_value(1e3 * seconds / steps), setting);
}

void run(BenchTrainArguments options) {
  require(options.seconds > 0 && options.seconds <= 3600, "--seconds", options.seconds, "must be in (0, 3600]");
  require(options.repeats >= 1 && options.repeats <= 100, "--repeats", options.repeats, "must be in [1, 100]");
  if (options.quick) options.seconds = 0.1, options.repeats = 1;
  if (options.config.empty()) {
    const auto usual = source_file("configs/train/avnav.yaml");
    if (!usual)
      throw InputError("--config", "is missing, and configs/train/avnav.yaml was not found in the source folder of this program",
                       "name a run config");
    options.config = *usual;
  }
  const RunConfig config = load_run_config(options.config, options.overrides);
  const TemporaryFolder folder(temporary_parent(), "earshot_bench_train_");
  LearnerSpeedTest test(config);
  const BenchJson setting = {{"config", std::filesystem::path(options.config).filename().string()},
                             {"parameters", test.num_parameters()},
                             {"envs", config.envs_per_worker},
                             {"rollout_steps", config.rollout_steps},
                             {"epochs", config.ppo.epochs},
                             {"minibatches", config.ppo.minibatches},
                             {"threads", 1},
                             {"seconds", options.seconds}};

  std::optional<std::string> python;
  const std::string request = (folder.path() / "request.json").string();
  if (!options.no_torch) {
    python = python_with_torch(options);
    if (!python) fmt::print("torch left out: no python3 here can import it (apt-get install python3-torch)\n");
    write_file_atomically(request, test.torch_request(options.seconds, !options.quick));
  }

  if (!options.quick) test.warm_up();
  std::vector<double> rate, wall_rate, forward, backward, step, other, actor, torch_rate, torch_wall_rate, ratio;
  std::string torch_version;
  for (int repeat = 0; repeat < options.repeats; ++repeat) {  // A B A B: other load of the machine affects both
    const LearnerSpeed speed = test.measure(options.seconds);
    rate.push_back(speed.samples_per_cpu_s);
    wall_rate.push_back(speed.samples_per_s);
    forward.push_back(speed.forward_ms);
    backward.push_back(speed.backward_ms);
    step.push_back(speed.step_ms);
    other.push_back(speed.other_ms);
    actor.push_back(speed.actor_rows_per_cpu_s);
    if (!python) continue;
    const nlohmann::json torch = ask_torch(*python, torch_script(), request);
    torch_rate.push_back(torch.at("samples_per_cpu_s").get<double>());
    torch_wall_rate.push_back(torch.at("samples_per_s").get<double>());
    torch_version = torch.value("torch", "");
    ratio.push_back(rate.back() / torch_rate.back());
  }
  BenchReport report("train");
  report.add("learner.samples_per_cpu_s", "1/s", median_of(rate), setting);
  report.add("learner.samples_per_s", "1/s", median_of(wall_rate), setting);
  report.add("learner.update_ms.forward", "ms", median_of(forward), setting);
  report.add("learner.update_ms.backward", "ms", median_of(backward), setting);
  report.add("learner.update_ms.step", "ms", median_of(step), setting);
  report.add("learner.update_ms.other", "ms", median_of(other), setting);
  report.add("actor.rows_per_cpu_s", "1/s", median_of(actor), setting);
  if (python) {
    BenchJson with_version = setting;
    with_version["torch"] = torch_version;
    report.add("torch.samples_per_cpu_s", "1/s", median_of(torch_rate), with_version);
    report.add("torch.samples_per_s", "1/s", median_of(torch_wall_rate), with_version);
    report.add("learner.ratio_to_torch", "1", median_of(ratio), with_version);
  }
  if (!options.no_training) add_training(config, options, folder.path(), setting, report);
  fmt::print("\n{}", report.table());
  report.write(options.json);
}

}  // namespace

void add_bench_train(CLI::App& bench) {
  const auto options = std::make_shared<BenchTrainArguments>();
  CLI::App* command =
      bench.add_subcommand("train",
                           "Measure the learner in samples per second and core, next to the same network in python3's torch if installed, "
                           "and a short training in steps per second by stage; one process, one thread");
  command->add_option("--config", options->config, "Run config (default: configs/train/avnav.yaml)");
  command->add_option("--set", options->overrides, "Override a key of the config: key=value; may be repeated")->allow_extra_args(false);
  command->add_option("--seconds", options->seconds, "Seconds of CPU time per repeat; the short training takes five times as long")
      ->capture_default_str();
  command->add_option("--repeats", options->repeats, "Repeats of the learner, interleaved with torch")->capture_default_str();
  command->add_option("--python", options->python, "Python interpreter with torch (default: python3, then /usr/bin/python3)");
  command->add_flag("--no-torch", options->no_torch, "Skip torch");
  command->add_flag("--no-training", options->no_training, "Skip the short training");
  command->add_option("--json", options->json, "Also write names, medians, ranges and settings to this JSON file")->type_name(kOutputFile);
  command->add_flag("--quick", options->quick, "Short smoke test; its numbers are not meaningful");
  command->callback([options] { run(*options); });
}

}  // namespace earshot
