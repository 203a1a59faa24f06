// SPDX-License-Identifier: Apache-2.0
#include "envs/batch/fault_desk.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/vec3.hpp>

#include "envs/hearing/finite_values.h"
#include "sim/base/engine_commit.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

/// After this many episodes that could not begin, and none that could, the set counts as unusable.
constexpr std::uint64_t kHopelessStarts = 64, kMaxOutOfMemory = 64;

}  // namespace

std::string stall_text(const EnvConfig& config) { return fmt::format("a stage exceeded stage_limit_s = {}", config.stage_limit_s); }

void FaultDesk::report(Agent& agent, Fault fault, std::string detail) {
  if (!agent.fault) agent.fault = {fault, std::move(detail)};
}

bool FaultDesk::check(Agent& agent, Fault kind, std::span<float> values) const {
  show({.kind = kind, .env = agent.env_id, .episode_index = agent.episode_index, .step = agent.state.steps(), .agent = agent.number},
       values);
  if (all_finite(values)) return true;
  const auto bad = std::find_if(values.begin(), values.end(), [](float value) { return !std::isfinite(value); });
  const Pose pose = agent.state.pose(setup_->config.task);
  const glm::dvec3 position = agent.source->scene->scene->to_world(pose.position);
  std::string detail = fmt::format("value {} of {} is {}, at position {:.4f} {:.4f} {:.4f}, heading {:.4f} rad", bad - values.begin(),
                                   values.size(), *bad, position.x, position.y, position.z, pose.heading_rad);
  if (setup_->per_env > 1) detail += fmt::format(", agent {}", agent.number);
  report(agent, kind, std::move(detail));
  return false;
}

void FaultDesk::quarantine(std::span<const Agent> agents, const FaultReport& fault) {
  const Agent& lead = agents.front();
  QuarantineRecord record{.report = fault,
                          .engine = engine_commit(),
                          .set_hash = setup_->set->hash,
                          .seed = lead.seed,
                          .episode_index = lead.episode_index,
                          .env = static_cast<int>(lead.stream),
                          .episode_count = lead.episode_count,
                          .step = 0,
                          .actions = lead.actions,
                          .episode = setup_->set->episodes[lead.episode_index],
                          .config = config_text(setup_->config)};
  for (const Agent& agent : agents) record.step = std::max(record.step, static_cast<int>(agent.actions.size()));
  for (const Agent& agent : agents.subspan(1)) record.others.push_back(agent.actions);
  quarantine_.add(record);
}

FinishedEpisode FaultDesk::failed_episode(const Agent& agent, const FaultReport& fault, bool began) const {
  FinishedEpisode failed{.env = agent.env_id,
                         .episode_index = agent.episode_index,
                         .metrics = began ? agent.state.metrics(setup_->config.task) : EpisodeMetrics{},
                         .actions = agent.actions,
                         .fault = fault,
                         .agent = agent.number};
  EpisodeMetrics& metrics = failed.metrics;
  metrics.success = metrics.spl = metrics.soft_spl = metrics.sna = metrics.success_when_silent = 0;
  metrics.steps = static_cast<int>(agent.actions.size());
  if (!began || metrics.steps == 0 || !std::isfinite(metrics.dtg_m))
    metrics.dtg_m = static_cast<double>(setup_->set->episodes[agent.episode_index].geodesic_distance_m);
  if (!std::isfinite(metrics.reward)) metrics.reward = 0;
  return failed;
}

void FaultDesk::stop_if_out_of_memory() const {
  if (out_of_memory_ >= kMaxOutOfMemory)
    throw RunError("environments",
                   fmt::format("are out of memory: {} stages of episodes could not have what they need", out_of_memory_.load()));
}

void FaultDesk::check_live_environments(std::span<const std::uint8_t> active) const {
  stop_if_out_of_memory();
  if (begun_ > 0 || failed_starts_ < std::min<std::uint64_t>(kHopelessStarts, setup_->set->episodes.size())) return;
  if (std::ranges::any_of(active, [](std::uint8_t flag) { return flag != 0; })) return;
  const QuarantineCounters by_reason = counters();
  std::string reasons;
  for (std::size_t i = 0; i < kNumFaults; ++i)
    if (by_reason.episodes[i] > 0)
      reasons += fmt::format("{}{} ({})", reasons.empty() ? "" : ", ", name_of(static_cast<Fault>(i)), by_reason.episodes[i]);
  throw InputError("episode set", fmt::format("none of the {} episodes could start; reasons: {}", failed_starts_.load(), reasons),
                   "check scene_root and sound_root; the log above shows the first case of each reason");
}

}  // namespace earshot
