// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "apps/commands.h"
#include "apps/options/output_options.h"
#include "envs/batch/batched_env.h"
#include "envs/episodes/episode_set.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/config_reader.h"
#include "sim/base/text/json.h"

namespace earshot {
namespace {

struct BenchBitsArguments {
  std::string env, episodes, json;
  int envs = 3, steps = 200, threads = 1;
  std::optional<int> restored;
};

/// XXH3 of every sensor, reward and flag over all steps, each array seeded by the hash of those before.  Actions are fixed: forward, left
/// and right by step and env.  restored: half way the state goes on in another batch with so many threads.
std::uint64_t hash_of_steps(const BenchBitsArguments& options) {
  EnvConfig config;
  ConfigReader reader = ConfigReader::from_file(options.env);
  read(reader, config);
  reader.finish();
  const auto set = std::make_shared<const EpisodeSet>(load_episode_set(options.episodes));
  const auto batch_on = [&](int threads) {
    EnvConfig env_config = config;
    env_config.threads = threads;
    validate(env_config);
    require(env_config.agents == 1, "agents", env_config.agents, "must be 1: each environment takes the actions of one agent");
    return std::make_unique<BatchedEnv>(env_config, set, make_scene_cache(env_config), options.envs);
  };
  auto batch = batch_on(options.threads);
  batch->reset();
  std::uint64_t hash = 0;
  const auto add = [&](std::span<const std::byte> bytes) { hash = hash64(bytes, hash); };
  std::vector<std::int32_t> actions(static_cast<std::size_t>(options.envs));
  for (int step = 0; step < options.steps; ++step) {
    if (options.restored && step == options.steps / 2) {
      const std::string state = batch->save_state();
      batch = batch_on(*options.restored);
      batch->restore(state);
    }
    for (int env = 0; env < options.envs; ++env) actions[static_cast<std::size_t>(env)] = 1 + (step * 3 + env * 5) % 7 % 3;
    batch->step(actions);
    for (const SensorSpec& sensor : batch->sensors()) add(batch->rows(sensor.name));
    add(std::as_bytes(batch->rewards()));
    add(std::as_bytes(batch->terminated()));
    add(std::as_bytes(batch->truncated()));
  }
  return hash;
}

void run_bits(const BenchBitsArguments& options) {
  require(options.envs >= 1 && options.envs <= 1024, "--envs", options.envs, "must lie in [1, 1024]");
  require(options.steps >= 1 && options.steps <= 1'000'000, "--steps", options.steps, "must lie in [1, 1000000]");
  const std::string hash = hex64(hash_of_steps(options));
  fmt::print("{}  {} steps of {} envs\n", hash, options.steps, options.envs);
  if (options.json.empty()) return;
  const nlohmann::ordered_json report{{"schema_version", 1}, {"hash", hash}, {"steps", options.steps}, {"envs", options.envs}};
  write_file_atomically(options.json, json_text(report, 2) + "\n");
}

}  // namespace

void add_bench_bits(CLI::App& bench) {
  const auto options = std::make_shared<BenchBitsArguments>();
  CLI::App* command = bench.add_subcommand(
      "bits", "Print a hash of everything a batch of environments returns over some steps; it must not depend on threads or on a restore");
  command->add_option("--env", options->env, "File with the keys of an env section (YAML), for example tests/pinned/batch.yaml")
      ->required();
  command->add_option("--episodes", options->episodes, "Episode set, for example tests/pinned/episodes.json")->required();
  command->add_option("--envs", options->envs, "Number of environments in the batch")->capture_default_str();
  command->add_option("--steps", options->steps, "Steps of each environment")->capture_default_str();
  command->add_option("--threads", options->threads, "Threads for the batch; 0: all cores")->capture_default_str();
  command->add_option("--restored", options->restored, "Half way, save the state and continue in another batch with this many threads");
  command->add_option("--json", options->json, "Also write the hash to this JSON file")->type_name(kOutputFile);
  command->callback([options] { run_bits(*options); });
}

}  // namespace earshot
