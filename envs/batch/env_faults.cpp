#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "envs/batch/batched_env_impl.h"
#include "envs/hearing/finite_values.h"
#include "sim/base/engine_commit.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

/// After this many episodes that could not begin, and none that could, the set counts as unusable.
constexpr std::uint64_t kHopeless = 64;
/// After this many episodes of one env in a row that began and went wrong the run ends.
constexpr int kMostInARow = 64;

}  // namespace

void BatchedEnv::Impl::report(std::size_t row, Fault fault, std::string detail) {
  if (!agents[row].fault) agents[row].fault = {fault, std::move(detail)};
}

const FaultReport* BatchedEnv::Impl::fault_of(std::size_t env) const {
  for (const Agent& agent : agents_of(env))
    if (agent.fault) return &*agent.fault;
  return nullptr;
}

bool BatchedEnv::Impl::check(std::size_t row, Fault kind, std::span<float> values) {
  const Agent& agent = agents[row];
  if (hook)
    hook({.kind = kind,
          .env = static_cast<int>(global_id(env_of(row))),
          .episode_index = agent.episode_index,
          .step = agent.state.steps(),
          .agent = agent_of(row)},
         values);
  if (all_finite(values)) return true;
  const auto bad = std::find_if(values.begin(), values.end(), [](float value) { return !std::isfinite(value); });
  const Pose pose = agent.state.pose(config.task);
  const glm::dvec3 position = agent.source->scene->scene->to_world(pose.position);
  std::string detail = fmt::format("value {} of {} is {}, at position {:.4f} {:.4f} {:.4f}, heading {:.4f} rad", bad - values.begin(),
                                   values.size(), *bad, position.x, position.y, position.z, pose.heading_rad);
  if (per_env > 1) detail += fmt::format(", agent {}", agent_of(row));
  report(row, kind, std::move(detail));
  return false;
}

void BatchedEnv::Impl::clear_row(std::size_t row) {
  rows.clear(row);
  agents[row].pictures_now.wanted = false;
}

void BatchedEnv::Impl::clear_rows(std::size_t env) {
  for (std::size_t row = first_row(env); row < first_row(env) + per_env; ++row) clear_row(row);
}

/// Counts the fault and writes its file.
void BatchedEnv::Impl::quarantine_episode(std::size_t env, const FaultReport& fault) {
  const std::span<const Agent> ours = agents_of(env);
  const Agent& lead = ours.front();
  QuarantineRecord record{.report = fault,
                          .engine = engine_commit(),
                          .set_hash = set->hash,
                          .seed = lead.seed,
                          .episode_index = lead.episode_index,
                          .env = static_cast<int>(lead.stream),
                          .episode_count = lead.episode_count,
                          .step = 0,
                          .actions = lead.actions,
                          .episode = episode_of(lead),
                          .config = config_text(config)};
  for (const Agent& agent : ours) record.step = std::max(record.step, static_cast<int>(agent.actions.size()));
  for (const Agent& agent : ours.subspan(1)) record.others.push_back(agent.actions);
  quarantine.add(record);
}

/// How the faulty episode counts among the finished: as failed, at the distance that is known.
FinishedEpisode BatchedEnv::Impl::failed_episode(std::size_t row, const FaultReport& fault, bool began) const {
  const Agent& agent = agents[row];
  FinishedEpisode failed_one{.env = static_cast<int>(global_id(env_of(row))),
                             .episode_index = agent.episode_index,
                             .metrics = began ? agent.state.metrics(config.task) : EpisodeMetrics{},
                             .actions = agent.actions,
                             .fault = fault,
                             .agent = agent_of(row)};
  EpisodeMetrics& metrics = failed_one.metrics;
  metrics.success = metrics.spl = metrics.soft_spl = metrics.sna = metrics.success_when_silent = 0;
  metrics.steps = static_cast<int>(agent.actions.size());
  if (!began || metrics.steps == 0 || !std::isfinite(metrics.dtg_m))
    metrics.dtg_m = static_cast<double>(episode_of(agent).geodesic_distance_m);
  if (!std::isfinite(metrics.reward)) metrics.reward = 0;
  return failed_one;
}

/// In the step that found the fault: no reward, truncated, all observations zero, of all agents of the env.
void BatchedEnv::Impl::end_faulty_episode(std::size_t env) {
  const FaultReport& fault = *fault_of(env);
  quarantine_episode(env, fault);
  for (Agent& agent : agents_of(env)) agent.outcome = {.truncated = true, .quarantined = true, .acted = agent.outcome.acted};
  clear_rows(env);
  for (Agent& agent : agents_of(env)) agent.waits = false;  // the last rows of all are zero
  // One bad scene among many does not reach this count; a broken set would continue without end and without a whole episode.
  if (++envs[env].faulty_in_a_row >= kMostInARow && config.order == EpisodeOrder::random)
    throw InputError(
        fmt::format("env {}", global_id(env)),
        fmt::format("{} episodes in a row were quarantined, the last one for its {}: {}", kMostInARow, name_of(fault.fault), fault.detail),
        "set quarantine_dir and run `earshot replay` on a file there");
}

/// Of a task that was given up: the env is out of the batch until its thread is done with it.  Reads nothing that a stage writes.
void BatchedEnv::Impl::quarantine_stalled(std::size_t env) {
  EnvRun& run = envs[env];
  const FaultReport fault{Fault::stall, fmt::format("a stage took longer than stage_limit_s = {}", config.stage_limit_s)};
  run.stalled = true;
  quarantine_episode(env, fault);
  for (std::size_t row = first_row(env); row < first_row(env) + per_env; ++row) {
    if (config.order == EpisodeOrder::once) run.stalled_ones.push_back(failed_episode(row, fault, false));
    rows.give_up(row);
  }
}

void BatchedEnv::Impl::stop_if_none_begins() const {
  if (begun > 0 || failed < std::min<std::uint64_t>(kHopeless, set->episodes.size())) return;
  if (std::ranges::any_of(rows.active(), [](std::uint8_t flag) { return flag != 0; })) return;
  const QuarantineCounters counters = quarantine.counters();
  std::string reasons;
  for (std::size_t i = 0; i < kNumFaults; ++i)
    if (counters.episodes[i] > 0)
      reasons += fmt::format("{}{} ({})", reasons.empty() ? "" : ", ", name_of(static_cast<Fault>(i)), counters.episodes[i]);
  throw InputError("episode set", fmt::format("none of {} episodes could begin; reasons: {}", failed.load(), reasons),
                   "the log above has the first of each reason; check scene_root and sound_root");
}

}  // namespace earshot
