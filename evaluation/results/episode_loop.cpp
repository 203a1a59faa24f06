// SPDX-License-Identifier: Apache-2.0
#include "evaluation/results/episode_loop.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <thread>

#include "evaluation/results/metric_rules.h"
#include "sim/base/engine_hash.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/process/progress.h"
#include "sim/base/stopwatch.h"
#include "sim/base/text/log.h"

namespace earshot {
namespace {

/// Every env has an abandoned stage, and none returns.
constexpr double kLongestIdleS = 600;

EvaluationResult::Row row_of(const Episode& episode, const FinishedEpisode& finished) {
  return {.id = episode.episode_id,
          .scene = episode.scene_id,
          .metrics = finished.metrics,
          .actions = finished.actions,
          .sound = episode.sound};
}

/// The rounds of episodes that one of several processes runs.  An env begins its next episode on request, with the number that the
/// episode has in one process; an env without one stays as it is, in its row.
class PartOfEpisodes {
 public:
  PartOfEpisodes(BatchedEnv& env, const EpisodeSet& set, const EvaluationPart& part, EvaluationResult& result)
      : env_(&env), set_(&set), part_(&part), result_(&result), rounds_(static_cast<std::size_t>(env.num_envs()), part.part) {}

  void run(const std::function<void(BatchedEnv&, std::span<std::int32_t>)>& act, const std::function<void(const BatchedEnv&)>& after) {
    std::vector<std::int32_t> live, live_actions, actions(rounds_.size());
    for (std::int32_t i = 0; i < env_->num_envs(); ++i)
      if (begin_next(i)) live.push_back(i);
    while (!live.empty()) {
      if (part_->on_step) part_->on_step();
      act(*env_, actions);
      live_actions.clear();
      for (const std::int32_t i : live) live_actions.push_back(actions[static_cast<std::size_t>(i)]);
      env_->send(live, live_actions);
      env_->recv(static_cast<int>(live.size()), RecvOrder::as_sent);
      after(*env_);
      const std::vector<FinishedEpisode> finished(env_->finished().begin(), env_->finished().end());  // begin() lets go of them
      for (const FinishedEpisode& episode : finished) {
        result_->episodes[static_cast<std::size_t>(episode.episode_index)] = row_of(set_->episodes[episode.episode_index], episode);
        ended();
        if (!begin_next(episode.env)) std::erase(live, episode.env);
      }
    }
  }

 private:
  void ended() {
    ++done_;
    if (part_->on_progress) part_->on_progress(done_);
  }

  /// False where the env has no episode left.
  bool begin_next(std::int32_t env) {
    int& round = rounds_[static_cast<std::size_t>(env)];
    for (;; round += part_->parts) {
      const std::size_t index = static_cast<std::size_t>(round) * rounds_.size() + static_cast<std::size_t>(env);
      if (index >= set_->episodes.size()) return false;
      const auto fault = env_->begin(env, index, round);
      if (!fault) break;
      const Episode& episode = set_->episodes[index];
      log_warning(
          fmt::format("episode '{}' in {} cannot start and counts as failed: {}", episode.episode_id, episode.scene_id, fault->detail));
      FinishedEpisode failed;
      failed.metrics.dtg_m = static_cast<double>(episode.geodesic_distance_m);
      result_->episodes[index] = row_of(episode, failed);
      ended();
    }
    round += part_->parts;
    return true;
  }

  BatchedEnv* env_;
  const EpisodeSet* set_;
  const EvaluationPart* part_;
  EvaluationResult* result_;
  std::vector<int> rounds_;  ///< next one of each env
  std::size_t done_ = 0;
};

}  // namespace

EvaluationResult run_episodes(const EnvConfig& base, const EvaluationConfig& evaluation, const std::string& name,
                              const std::function<void(BatchedEnv&, std::span<std::int32_t>)>& act,
                              const std::function<void(const BatchedEnv&)>& after) {
  EvaluationResult result;
  const auto set = load_evaluated_set(evaluation, &result.partial_of);
  EnvConfig config = base;
  config.order = EpisodeOrder::once;
  config.threads = evaluation.threads;
  if (evaluation.part) config.autoreset = Autoreset::off;
  const auto scenes = evaluation.scenes ? evaluation.scenes : make_scene_cache(config);
  const auto num_episodes = set->episodes.size();
  const int num_envs = evaluation_batch(evaluation, num_episodes);
  BatchedEnv env(config, set, scenes, num_envs);

  result.agent = name;
  result.set_hash = hex64(set->hash);
  result.engine_hash = engine_hash();
  result.toolchain = simulation_toolchain();
  result.episodes_file = evaluation.episodes;
  result.seed = evaluation.seed;
  result.rules = metric_rules(config, num_envs);
  result.senses = sensed_config(config);
  result.episodes.resize(num_episodes);
  if (evaluation.part) {
    PartOfEpisodes(env, *set, *evaluation.part, result).run(act, after);
    return result;
  }

  env.reset();
  std::vector<std::int32_t> actions(static_cast<std::size_t>(num_envs));
  Progress progress("evaluate " + name, "episode", num_episodes);
  Stopwatch idle;
  for (std::size_t done = 0; done < num_episodes;) {
    act(env, actions);
    env.step(actions);
    after(env);
    for (const auto& episode : env.finished()) {
      result.episodes[static_cast<std::size_t>(episode.episode_index)] = row_of(set->episodes[episode.episode_index], episode);
      ++done;
    }
    progress.update(done);
    if (std::ranges::any_of(env.active(), [](std::uint8_t flag) { return flag != 0; })) {
      idle = Stopwatch();
    } else if (done < num_episodes) {  // stages that were given up hold all that is left
      if (idle.wall_s() > kLongestIdleS)
        throw RunError("evaluation",
                       fmt::format("{} of {} episodes are stuck in a stage that does not finish", num_episodes - done, num_episodes));
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
  }
  return result;
}

}  // namespace earshot
