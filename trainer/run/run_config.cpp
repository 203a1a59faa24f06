#include "trainer/run/run_config.h"

#include <fmt/format.h>

#include "sim/base/control_characters.h"
#include "sim/base/text/config_reader.h"
#include "trainer/collective/collective.h"

namespace earshot {
namespace {

void read(ConfigReader& reader, RunConfig& config) {
  reader.read("name", config.name);
  reader.read("out", config.out);
  reader.read("seed", config.seed);
  reader.read("workers", config.workers);
  reader.read("envs_per_worker", config.envs_per_worker);
  reader.read("rollout_steps", config.rollout_steps);
  reader.read("overlap", config.overlap);
  reader.read("total_steps", config.total_steps);
  reader.read("max_minutes", config.max_minutes);
  reader.read("checkpoint_every", config.checkpoint_every);
  reader.read("keep", config.keep);
  reader.read("metrics_file", config.metrics_file);
  reader.read("eval_envs", config.eval_envs);
  reader.read("initial_policy", config.initial_policy);
  reader.read_choice<Schedule>("schedule", config.schedule, {{"steps", Schedule::steps}, {"minutes", Schedule::minutes}});
  reader.read_choice<ActionChoice>("eval_actions", config.eval_actions,
                                   {{"sample", ActionChoice::sample}, {"argmax", ActionChoice::argmax}});

  read_env_section(reader, config.env);
  ConfigReader policy = reader.child("policy");
  read(policy, config.policy);
  policy.finish();
  ConfigReader ppo = reader.child("ppo");
  read(ppo, config.ppo);
  ppo.finish();
  ConfigReader guidance = reader.child("guidance");
  read(guidance, config.guidance);
  guidance.finish();
  ConfigReader network = reader.child("network");
  read(network, config.network);
  network.finish();
  read_data_section(reader, config.train, config.eval);
}

RunConfig read_run(ConfigReader reader) {
  RunConfig config;
  // Two keys are the defaults of others.
  reader.read("name", config.name);
  reader.read("seed", config.seed);
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
  validate(config.network);
  require(config.guidance.goal == 0 || config.policy.goal_heads, "guidance.goal", config.guidance.goal,
          "has no effect without policy.goal_heads, which predict the goal");
  require(config.guidance.goal > 0 || !config.policy.goal_heads, "policy.goal_heads", true,
          "has no effect without guidance.goal, the weight of their loss");
  require(config.schedule == Schedule::steps || config.max_minutes > 0, "schedule", "minutes", "needs max_minutes");
  validate_world(config.workers, config.network.on_loss);
  require(config.envs_per_worker >= 1, "envs_per_worker", config.envs_per_worker, "must be positive");
  require(!config.overlap || config.envs_per_worker >= 2, "overlap", true, "needs at least two environments per worker");
  require(config.rollout_steps >= 1, "rollout_steps", config.rollout_steps, "must be positive");
  require(config.total_steps >= 1, "total_steps", config.total_steps, "must be positive");
  require(config.max_minutes >= 0, "max_minutes", config.max_minutes, "must not be negative; 0: no time limit");
  require(config.checkpoint_every >= 1, "checkpoint_every", config.checkpoint_every, "must be positive");
  require(config.keep >= 1, "keep", config.keep, "must be positive: the newest checkpoint is always kept");
  require(config.eval_envs >= 1, "eval_envs", config.eval_envs, "must be positive");
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
          .hidden_size = config.policy.hidden_size,
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
