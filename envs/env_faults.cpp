#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "envs/batched_env_impl.h"
#include "envs/engine_commit.h"
#include "envs/finite_values.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

/// After this many episodes that could not begin, and none that could, the set counts as unusable.
constexpr std::uint64_t kHopeless = 64;
/// After this many episodes of one env in a row that began and went wrong the run ends.
constexpr int kMostInARow = 64;

}  // namespace

void BatchedEnv::Impl::report(std::size_t env, Fault fault, std::string detail) {
  if (!agents[env].fault) agents[env].fault = {fault, std::move(detail)};
}

bool BatchedEnv::Impl::check(std::size_t env, Fault kind, std::span<float> values) {
  const Agent& agent = agents[env];
  if (hook)
    hook({.kind = kind, .env = static_cast<int>(global_id(env)), .episode_index = agent.episode_index, .step = agent.state.steps()},
         values);
  if (all_finite(values)) return true;
  const auto bad = std::find_if(values.begin(), values.end(), [](float value) { return !std::isfinite(value); });
  const Pose pose = agent.state.pose(config.task);
  const glm::dvec3 position = agent.source->scene->scene->to_world(pose.position);
  report(env, kind,
         fmt::format("value {} of {} is {}, at position {:.4f} {:.4f} {:.4f}, heading {:.4f} rad", bad - values.begin(), values.size(),
                     *bad, position.x, position.y, position.z, pose.heading_rad));
  return false;
}

void BatchedEnv::Impl::clear_rows(std::size_t env) {
  for (const auto& sensor : sensor_rows) sensor->clear(env);
  agents[env].pictures_now.wanted = false;
}

/// Counts the fault and writes its file.
void BatchedEnv::Impl::quarantine_episode(std::size_t env, const FaultReport& fault) {
  const Agent& agent = agents[env];
  quarantine.add({.report = fault,
                  .engine = engine_commit(),
                  .set_hash = set->hash,
                  .seed = agent.seed,
                  .episode_index = agent.episode_index,
                  .env = static_cast<int>(agent.stream),
                  .episode_count = agent.episode_count,
                  .step = static_cast<int>(agent.actions.size()),
                  .actions = agent.actions,
                  .episode = episode_of(agent),
                  .config = config_text(config)});
}

/// How the faulty episode counts among the finished: as failed, at the distance that is known.
FinishedEpisode BatchedEnv::Impl::failed_episode(std::size_t env, const FaultReport& fault) const {
  const Agent& agent = agents[env];
  FinishedEpisode failed_one{.env = static_cast<int>(global_id(env)),
                             .episode_index = agent.episode_index,
                             .metrics = agent.state.metrics(config.task),
                             .actions = agent.actions,
                             .fault = fault};
  EpisodeMetrics& metrics = failed_one.metrics;
  metrics.success = metrics.spl = metrics.soft_spl = metrics.sna = metrics.success_when_silent = 0;
  metrics.steps = static_cast<int>(agent.actions.size());
  if (metrics.steps == 0 || !std::isfinite(metrics.dtg_m)) metrics.dtg_m = static_cast<double>(episode_of(agent).geodesic_distance_m);
  if (!std::isfinite(metrics.reward)) metrics.reward = 0;
  return failed_one;
}

/// In the step that found the fault: no reward, truncated, all observations zero.
void BatchedEnv::Impl::end_faulty_episode(std::size_t env) {
  if (!agents[env].fault) return;
  quarantine_episode(env, *agents[env].fault);
  rewards[env] = 0.f;
  terminated[env] = collided[env] = 0;
  truncated[env] = quarantined[env] = 1;
  clear_rows(env);
  // One bad scene among many does not reach this count; a broken set would continue without end and without a whole episode.
  if (++agents[env].faulty_in_a_row >= kMostInARow && config.order == EpisodeOrder::random)
    throw InputError(fmt::format("env {}", global_id(env)),
                     fmt::format("{} episodes in a row were quarantined, the last one for its {}: {}", kMostInARow,
                                 name_of(agents[env].fault->fault), agents[env].fault->detail),
                     "set quarantine_dir and run `earshot replay` on a file there");
}

/// Of a task that was given up: the env is out of the batch until its thread is done with it.
void BatchedEnv::Impl::quarantine_stalled(std::size_t env) {
  Agent& agent = agents[env];
  const FaultReport fault{Fault::stall, fmt::format("a stage took longer than stage_limit_s = {}", config.stage_limit_s)};
  active[env] = 0;
  agent.stalled = true;
  quarantine_episode(env, fault);
  if (config.order == EpisodeOrder::once) agent.stalled_one = failed_episode(env, fault);
  clear_outcome(env);
  truncated[env] = quarantined[env] = 1;
  clear_rows(env);
  for (const auto& sensor : sensor_rows) sensor->keep(env);
}

void BatchedEnv::Impl::stop_if_none_begins() const {
  if (begun > 0 || failed < std::min<std::uint64_t>(kHopeless, set->episodes.size())) return;
  if (std::ranges::any_of(active, [](std::uint8_t flag) { return flag != 0; })) return;
  const QuarantineCounters counters = quarantine.counters();
  std::string reasons;
  for (std::size_t i = 0; i < kNumFaults; ++i)
    if (counters.episodes[i] > 0)
      reasons += fmt::format("{}{} ({})", reasons.empty() ? "" : ", ", name_of(static_cast<Fault>(i)), counters.episodes[i]);
  throw InputError("episode set", fmt::format("none of {} episodes could begin; reasons: {}", failed.load(), reasons),
                   "the log above has the first of each reason; check scene_root and sound_root");
}

}  // namespace earshot
