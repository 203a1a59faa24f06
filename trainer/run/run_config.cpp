// SPDX-License-Identifier: Apache-2.0
#include "trainer/run/run_config.h"

#include <fmt/format.h>

#include "sim/base/control_characters.h"
#include "sim/base/text/config_reader.h"
#include "trainer/collective/collective.h"

namespace earshot {
namespace {

void read_sections(ConfigReader& reader, RunConfig& config) {
  read_env_section(reader, config.env);
  const auto section = [&](const char* key, auto& part, About about) {
    ConfigReader child = reader.child(key, about);
    read(child, part);
    child.finish();
  };
  section("policy", config.policy, "Network of the policy.");
  section("ppo", config.ppo, "Learner: proximal policy optimization with synchronous workers (DD-PPO).");
  section("guidance", config.guidance, "Labels of the simulator that training uses beside rewards; none in evaluation.");
  section("held_out", config.held_out, "Evaluations on data.held_out while the run trains, which choose best.ckpt.");
  section("network", config.network, "Connections between workers, needed only for several hosts.");
  read_data_section(reader, config.train, config.eval, config.held_out_data);
}

void read_name(ConfigReader& reader, RunConfig& config) { reader.read("name", config.name, "Name of the run."); }

void read_seed(ConfigReader& reader, RunConfig& config) {
  reader.read("seed", config.seed, "Seed of the run: of env.seed and policy.seed unless they are set, and of sampled actions.");
}

}  // namespace

void read(ConfigReader& reader, RunConfig& config) {
  read_name(reader, config);
  reader.read("out", config.out, Allowed::text("a folder"), "Folder of checkpoints, curves and results; default: runs/NAME.");
  read_seed(reader, config);
  reader.read("workers", config.workers, Allowed::between(1, kMaxWorkers),
              "Worker processes on this machine; a launcher takes precedence.");
  reader.read("envs_per_worker", config.envs_per_worker, Allowed::at_least(1), "Environments of each worker.");
  reader.read("rollout_steps", config.rollout_steps, Allowed::at_least(1), "Steps of each environment between two updates.");
  reader.read("overlap", config.overlap, "Steps the environments in two halves, one while the policy computes the other's actions.");
  reader.read("total_steps", config.total_steps, Allowed::at_least(1), "Environment steps of the training, over all workers.");
  reader.read("max_minutes", config.max_minutes, Allowed::at_least(0), "Wall time of the training. 0: no bound.");
  reader.read("checkpoint_every", config.checkpoint_every, Allowed::at_least(1), "Updates between two periodic checkpoints.");
  reader.read("keep", config.keep, Allowed::at_least(1), "Periodic checkpoints that are kept, beside the best and the last.");
  reader.read("metrics_file", config.metrics_file, Allowed::text("a file"),
              "Text file for Prometheus that each update replaces. Empty: none.");
  reader.read("eval_envs", config.eval_envs, Allowed::at_least(1), "Environments of the evaluation; a part of its bits.");
  reader.read("initial_policy", config.initial_policy, Allowed::text("a policy file, checkpoint or run folder"),
              "Policy whose weights a new run starts from. Empty: random weights from policy.seed.");
  reader.read_choice<Schedule>("schedule", config.schedule, {{"steps", Schedule::steps}, {"minutes", Schedule::minutes}},
                               "Measure of progress for decays and guidance. steps: total_steps, the same bits on every machine. minutes: "
                               "total_steps or max_minutes, whichever comes first.");
  reader.read_choice<ActionChoice>("eval_actions", config.eval_actions,
                                   {{"sample", ActionChoice::sample}, {"argmax", ActionChoice::argmax}},
                                   "Actions of the evaluated policy. sample: drawn from its distribution. argmax: the likeliest.");
  read_sections(reader, config);
}

namespace {

RunConfig read_run(ConfigReader reader) {
  RunConfig config;
  // Two keys are the defaults of others.
  read_name(reader, config);
  read_seed(reader, config);
  config.out = "runs/" + config.name;
  config.env.seed = config.policy.seed = config.seed;
  read(reader, config);
  reader.finish();

  validate(config.env);
  require(config.env.autoreset == Autoreset::same_step, "env.autoreset", config.env.autoreset == Autoreset::off ? "off" : "next_step",
          "must be same_step in a run: rollouts and evaluations start the next episode in the step that ends one");
  require(config.env.agents == 1, "env.agents", config.env.agents,
          "must be 1 in a run: rollouts and results have one agent per environment; BatchedEnv and 'earshot bench env' support more");
  validate(config.policy);
  validate(config.ppo);
  validate(config.guidance);
  validate(config.held_out);
  require(!config.held_out.is_on() || !config.held_out_data.file.empty(), "held_out.every_updates", config.held_out.every_updates,
          "needs data.held_out with a file: episodes in scenes that data.train does not have");
  validate(config.network);
  require(config.guidance.goal == 0 || config.policy.goal_heads, "guidance.goal", config.guidance.goal,
          "has no effect without policy.goal_heads, which predict the goal");
  require(config.guidance.goal > 0 || !config.policy.goal_heads, "policy.goal_heads", true,
          "has no effect without guidance.goal, the weight of their loss");
  require(config.schedule == Schedule::steps || config.max_minutes > 0, "schedule", "minutes", "needs max_minutes");
  validate_world(config.workers, config.network.on_loss);
  require(!config.overlap || config.envs_per_worker >= 2, "overlap", true, "needs at least two environments per worker");
  require(!config.out.empty(), "out", config.out, "must name a folder");
  require(!has_control_character(config.name), "name", config.name, "must not have control characters: tables print it");
  return config;
}

}  // namespace

ObservationSpec training_sensors(const RunConfig& config) {
  ObservationSpec spec = config.env.observation;
  spec.oracle_action = spec.oracle_action || config.guidance.imitation > 0 || config.guidance.imitation_end_weight > 0;
  spec.goal_state = spec.goal_state || config.guidance.goal > 0 || config.policy.guided_critic;
  return spec;
}

RolloutConfig rollout_config(const RunConfig& config) {
  return {.seed = config.seed,
          .rollout_steps = config.rollout_steps,
          .overlap = config.overlap,
          .sensors = training_sensors(config),
          .guidance = config.guidance};
}

RunConfig load_run_config(const std::filesystem::path& path, const std::vector<std::string>& overrides) {
  return read_run(ConfigReader::from_file(path, overrides));
}

RunConfig parse_run_config(std::string_view yaml, const std::string& where, const std::vector<std::string>& overrides) {
  return read_run(ConfigReader::from_text(yaml, where, overrides));
}

std::string config_text(const RunConfig& config) {
  ConfigReader recorder = ConfigReader::recorder();
  RunConfig copy = config;
  read(recorder, copy);
  return recorder.effective();
}

}  // namespace earshot
