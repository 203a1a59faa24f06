// SPDX-License-Identifier: Apache-2.0
#include "envs/baselines/baselines.h"

#include <array>
#include <utility>

#include "envs/baselines/baseline_classical.h"
#include "envs/baselines/baseline_greedy.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr std::array<std::pair<std::string_view, Baseline>, 5> kNames = {{{"random", Baseline::random},
                                                                          {"random_oracle_stop", Baseline::random_oracle_stop},
                                                                          {"greedy", Baseline::greedy},
                                                                          {"classical", Baseline::classical},
                                                                          {"oracle", Baseline::oracle}}};

std::unique_ptr<BaselineMemory> make_memory(Baseline baseline, const EnvConfig& config) {
  const bool listens = baseline == Baseline::greedy || baseline == Baseline::classical;
  if (listens && config.observation.hears() && !config.observation.has_ears())
    throw InputError(baseline_name(baseline), "listens with two ears, but observation.channels is '" + config.observation.channels + "'",
                     "set observation.channels to binaural");
  switch (baseline) {
    case Baseline::greedy:
      return std::make_unique<GreedyAgent>(config);
    case Baseline::classical:
      return std::make_unique<ClassicalAgent>(config);
    case Baseline::random:
    case Baseline::random_oracle_stop:
    case Baseline::oracle:
      break;
  }
  return nullptr;
}

/// The part of row `row` in [rows, ...].
std::span<const float> row_of(std::span<const float> all, std::size_t row, std::size_t rows) {
  const std::size_t size = all.size() / rows;
  return all.subspan(row * size, size);
}

}  // namespace

std::optional<Baseline> baseline_by_name(std::string_view name) {
  for (const auto& [known, baseline] : kNames)
    if (known == name) return baseline;
  return std::nullopt;
}

std::string_view baseline_name(Baseline baseline) {
  for (const auto& [name, known] : kNames)
    if (known == baseline) return name;
  return {};
}

std::vector<SensorKind> sensors_of(Baseline baseline) {
  if (baseline != Baseline::greedy && baseline != Baseline::classical) return {};
  return {SensorKind::heard, SensorKind::waveform, SensorKind::depth, SensorKind::collision};
}

bool reads_simulator(Baseline baseline) { return baseline == Baseline::random_oracle_stop || baseline == Baseline::oracle; }

std::string baseline_names() {
  std::string names;
  for (const auto& entry : kNames) names += (names.empty() ? "" : " ") + std::string(entry.first);
  return names;
}

BaselineAgent::BaselineAgent(Baseline baseline, const EnvConfig& config, int num_rows, std::uint64_t seed, int first_env)
    : baseline_(baseline), seed_(seed), first_env_(first_env), rows_(static_cast<std::size_t>(num_rows)) {
  for (Row& row : rows_) row.memory = make_memory(baseline, config);
}

void BaselineAgent::act(const BatchedEnv& env, std::span<std::int32_t> actions) {
  EARSHOT_EXPECT(actions.size() == rows_.size() && env.num_rows() == static_cast<int>(rows_.size()));
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    Row& row = rows_[i];
    const int index = static_cast<int>(i);
    actions[i] = static_cast<std::int32_t>(Action::stop);
    if (!env.active()[i]) continue;
    const AgentPlace place = env.agent(index);
    const int episode = place.episode_count, step = place.episode_step;
    const RandomStream random(seed_, Purpose::random_agent, static_cast<std::uint32_t>(first_env_ + index),
                              static_cast<std::uint32_t>(episode), static_cast<std::uint32_t>(step));
    Action action = Action::stop;
    switch (baseline_) {
      case Baseline::random:
        action = static_cast<Action>(random.below(kNumActions, 0));
        break;
      case Baseline::random_oracle_stop:
        if (oracle_action(env.config().task, env.goal(index), place.pose) != Action::stop)
          action = static_cast<Action>(1 + random.below(kNumActions - 1, 0));
        break;
      case Baseline::greedy:
      case Baseline::classical:
        if (episode != row.episode || step != row.step + 1) row.memory->begin();
        action = row.memory->act({.heard = row_of(float_rows(env, "heard"), i, rows_.size()),
                                  .new_samples = float_rows(env, "waveform").size() / (2 * rows_.size()),
                                  .depth = row_of(float_rows(env, "depth"), i, rows_.size()),
                                  .collided = env.collided()[i] != 0},
                                 random);
        break;
      case Baseline::oracle:
        action = oracle_action(env.config().task, env.goal(index), place.pose);
        break;
    }
    row.episode = episode;
    row.step = step;
    actions[i] = static_cast<std::int32_t>(action);
  }
}

}  // namespace earshot
