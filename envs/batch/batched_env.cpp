// SPDX-License-Identifier: Apache-2.0
#include "envs/batch/batched_env.h"

#include <fmt/format.h>
#include <tbb/info.h>

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "envs/batch/agent_camera.h"
#include "envs/batch/agent_senses.h"
#include "envs/batch/batch_rows.h"
#include "envs/batch/batch_setup.h"
#include "envs/batch/env_scheduler.h"
#include "envs/batch/env_state.h"
#include "envs/batch/environment.h"
#include "envs/batch/episode_entry.h"
#include "envs/batch/fault_desk.h"
#include "envs/batch/picture_queue.h"
#include "envs/hearing/engine_pool.h"
#include "sim/base/errors.h"

namespace earshot {

/// The objects of a batch; each uses those above it.
struct BatchedEnv::Impl {
  BatchSetup setup;
  BatchRows rows;
  std::vector<AgentCamera> cameras;
  FaultDesk faults;
  PictureQueue pictures;
  EnginePool engines;
  AgentSenses senses;
  EpisodeEntry entry;
  std::vector<Agent> agents;  ///< by row
  std::vector<Environment> envs;
  EnvScheduler scheduler;  ///< last: its threads use what is above

  Impl(const EnvConfig& config, std::shared_ptr<const EpisodeSet> set, std::shared_ptr<SceneCache> scenes, int num_envs, int first_env,
       int total_envs)
      : setup(config, std::move(set), std::move(scenes), num_envs, first_env, total_envs),
        rows(setup.config.observation, setup.block_samples, setup.num_rows()),
        cameras(make_cameras(setup.config.observation, rows)),
        faults(setup),
        pictures(setup.config.observation, cameras, faults),
        engines(setup.config, setup.block_samples),
        senses(setup, rows, cameras, pictures, faults),
        entry(setup, rows),
        agents(make_agents()),
        envs(make_envs()),
        scheduler(parts(), pictures, envs, std::min(num_threads(), num_envs)) {
    engines.resize(scheduler.workers().num_workers(), envs.size() * helpers_per_env());
  }

  [[nodiscard]] EnvParts parts() {
    return {.setup = setup, .rows = rows, .faults = faults, .senses = senses, .entry = entry, .engines = engines};
  }
  [[nodiscard]] int num_threads() const { return setup.config.threads > 0 ? setup.config.threads : tbb::info::default_concurrency(); }
  /// Threads that envs leave over share the agents of each.  An abandoned stage keeps its thread, so there are no helper threads with a
  /// time limit.
  [[nodiscard]] std::size_t helpers_per_env() const {
    if (setup.per_env <= 1 || setup.config.stage_limit_s != 0) return 0;
    const std::size_t threads_per_env = size_of(num_threads()) / size_of(setup.num_envs);
    return std::min(threads_per_env, setup.per_env) - std::min(threads_per_env, std::size_t{1});
  }
  [[nodiscard]] std::vector<Agent> make_agents() const {
    const NavmeshConfig& body = setup.config.navmesh;
    std::vector<Agent> made(setup.num_rows());
    for (std::size_t row = 0; row < made.size(); ++row) {
      made[row].row = row;
      made[row].number = static_cast<int>(row % setup.per_env);
      made[row].env_id = static_cast<int>(setup.global_id(row / setup.per_env));
      made[row].around = {.places = {}, .apart_m = 2 * body.agent_radius_m, .height_m = body.agent_height_m};
    }
    return made;
  }
  [[nodiscard]] std::vector<Environment> make_envs() {
    std::vector<Environment> made;
    made.reserve(size_of(setup.num_envs));
    for (std::size_t env = 0; env < size_of(setup.num_envs); ++env)
      made.emplace_back(parts(), std::span(agents).subspan(env * setup.per_env, setup.per_env), env, helpers_per_env());
    return made;
  }

  /// Throws std::out_of_range.
  [[nodiscard]] const Agent& agent_at(int row) const {
    if (row < 0 || size_of(row) >= agents.size())
      throw std::out_of_range(fmt::format("BatchedEnv: agent {} is out of range: the batch has {} agents", row, agents.size()));
    return agents[size_of(row)];
  }
  /// Throws InputError where the episode set is another one, or a file of the same name has other contents.
  void check_inputs(const EnvState& state) const;
  void check_cursor(const EnvCursor& cursor) const;
};

namespace {

[[noreturn]] void refuse_state(const std::string& problem) {
  throw InputError("environment state", problem, "restore it with the same episode set, seed and batch");
}

}  // namespace

void BatchedEnv::Impl::check_inputs(const EnvState& state) const {
  if (state.set_hash != setup.set->hash) refuse_state("belongs to another episode set");
  const FileHashes heard = heard_in_all(setup.heard);
  for (const auto& [name, hash] : state.heard)
    if (const auto found = heard.find(name); found != heard.end() && found->second != hash)
      throw InputError(name, "has changed since the environment state was saved", "restore the file, or begin a new run");
}

void BatchedEnv::Impl::check_cursor(const EnvCursor& cursor) const {
  if (cursor.active && cursor.episode_index >= setup.set->episodes.size()) refuse_state("refers to an episode that is not in the set");
  if (cursor.others.size() + 1 != setup.per_env) refuse_state("has a different number of agents");
  std::size_t longest = cursor.actions.size();
  for (const auto& actions : cursor.others) longest = std::max(longest, actions.size());
  if (longest > size_of(setup.config.task.max_steps)) refuse_state("has an episode longer than task.max_steps");
  if (cursor.ended && !cursor.is_void && setup.config.autoreset == Autoreset::same_step)
    refuse_state("has an ended episode, which autoreset same_step cannot have");
}

BatchedEnv::BatchedEnv(const EnvConfig& config, std::shared_ptr<const EpisodeSet> set, std::shared_ptr<SceneCache> scenes, int num_envs,
                       int first_env, int total_envs)
    : impl_(new Impl(config, std::move(set), std::move(scenes), num_envs, first_env, total_envs)) {}

void BatchedEnv::Release::operator()(Impl* impl) const noexcept {
  if (impl->scheduler.workers().tasks_given_up() == 0) delete impl;
}

void BatchedEnv::reset() { impl_->scheduler.reset(); }
void BatchedEnv::reset(std::span<const std::uint8_t> mask, std::span<const std::uint64_t> seeds) { impl_->scheduler.reset(mask, seeds); }
void BatchedEnv::step(std::span<const std::int32_t> actions) { impl_->scheduler.step(actions); }
void BatchedEnv::send(std::span<const std::int32_t> envs, std::span<const std::int32_t> actions) { impl_->scheduler.send(envs, actions); }
void BatchedEnv::wait_ready(int min_ready, RecvOrder order) { impl_->scheduler.wait_ready(min_ready, order); }
bool BatchedEnv::works_in_background() const { return impl_->scheduler.workers().is_busy() || impl_->setup.scenes->loads_ahead(); }
std::span<const std::int32_t> BatchedEnv::recv(int min_ready, RecvOrder order) { return impl_->scheduler.recv(min_ready, order); }
std::optional<FaultReport> BatchedEnv::begin(int env, std::uint64_t episode_index, int episode_count, std::optional<std::uint32_t> stream) {
  return impl_->scheduler.begin(env, episode_index, episode_count, stream);
}
void BatchedEnv::place(int env, const Pose& pose, int steps) {
  impl_->scheduler.refuse_while_under_way("place");  // its task may replace the scene
  const std::size_t index = impl_->scheduler.index_of(env);
  const auto& source = impl_->agents[index * impl_->setup.per_env].source;
  Pose placed = pose;
  if (source) {  // without an episode the scheduler refuses
    const auto found = source->scene->navmesh.snap(source->scene->scene->to_local(pose.position));
    if (!found) throw InputError("place", "is off the walkable surface", "choose a place on the floor");
    placed.position = *found;
  }
  impl_->scheduler.place(env, placed, steps);
}

std::string BatchedEnv::save_state() const {
  const Impl& in = *impl_;
  EnvState state{.set_hash = in.setup.set->hash,
                 .seed = in.setup.config.seed,
                 .first_env = in.setup.first_env,
                 .total_envs = in.setup.total_envs,
                 .started = in.scheduler.has_started(),
                 .envs = {},
                 .heard = heard_in_all(in.setup.heard)};
  in.scheduler.refuse_while_under_way("save_state");
  for (std::size_t env = 0; env < in.envs.size(); ++env) state.envs.push_back(in.scheduler.cursor_of(env));
  return encode(state);
}

void BatchedEnv::restore(std::string_view text) {
  Impl& in = *impl_;
  in.scheduler.refuse_while_under_way("restore");
  const EnvState state = decode_env_state(text);
  in.check_inputs(state);
  if (state.seed != in.setup.config.seed) refuse_state("has a different seed");
  if (state.envs.size() != in.envs.size() || state.first_env != in.setup.first_env || state.total_envs != in.setup.total_envs)
    refuse_state("belongs to another batch of environments");
  for (const EnvCursor& cursor : state.envs) in.check_cursor(cursor);
  in.scheduler.restore(state.envs, state.started);
}

std::string BatchedEnv::snapshot(int env) const {
  const Impl& in = *impl_;
  const std::size_t index = in.scheduler.index_of(env);
  if (in.scheduler.is_under_way(index))
    throw std::logic_error(fmt::format("BatchedEnv::snapshot: environment {} is still stepping; call recv() first", env));
  const EnvCursor cursor = in.scheduler.cursor_of(index);
  const bool has_episode = cursor.active && cursor.episode_index < in.setup.set->episodes.size();
  return encode({.set_hash = in.setup.set->hash,
                 .seed = in.setup.config.seed,
                 .first_env = 0,
                 .total_envs = 1,
                 .started = in.scheduler.has_started(),
                 .envs = {cursor},
                 .heard = has_episode ? heard_in(in.setup.set->episodes[cursor.episode_index], in.setup.heard) : in.setup.heard.ears});
}

void BatchedEnv::restore(int env, std::string_view snapshot) {
  Impl& in = *impl_;
  in.scheduler.refuse_while_under_way("restore");
  const std::size_t index = in.scheduler.index_of(env);
  const EnvState state = decode_env_state(snapshot);
  in.check_inputs(state);
  if (state.envs.size() != 1 || !state.started) refuse_state("is not a snapshot of a single environment with an episode");
  if (!in.scheduler.has_started()) throw std::logic_error("BatchedEnv::restore: no episode has started; reset all environments first");
  in.check_cursor(state.envs.front());
  in.scheduler.restore(index, state.envs.front());
}

int BatchedEnv::num_envs() const { return impl_->setup.num_envs; }
int BatchedEnv::num_rows() const { return static_cast<int>(impl_->agents.size()); }
const EnvConfig& BatchedEnv::config() const { return impl_->setup.config; }

std::span<const SensorSpec> BatchedEnv::sensors() const { return impl_->rows.table(); }
std::span<const std::byte> BatchedEnv::rows(std::string_view sensor) const { return impl_->rows.now(sensor); }
std::span<const std::byte> BatchedEnv::final_rows(std::string_view sensor) const { return impl_->rows.last(sensor); }
std::span<const float> BatchedEnv::rewards() const { return impl_->rows.rewards(); }
std::span<const std::uint8_t> BatchedEnv::terminated() const { return impl_->rows.terminated(); }
std::span<const std::uint8_t> BatchedEnv::truncated() const { return impl_->rows.truncated(); }
std::span<const std::uint8_t> BatchedEnv::active() const { return impl_->rows.active(); }
std::span<const std::uint8_t> BatchedEnv::collided() const { return impl_->rows.collided(); }
std::span<const std::uint8_t> BatchedEnv::quarantined() const { return impl_->rows.quarantined(); }
std::span<const std::uint8_t> BatchedEnv::acted() const { return impl_->rows.acted(); }
std::span<const FinishedEpisode> BatchedEnv::finished() const { return impl_->scheduler.finished(); }

AgentPlace BatchedEnv::agent(int row) const {
  const Agent& agent = impl_->agent_at(row);
  return {.pose = agent.state.pose(impl_->setup.config.task),
          .episode_index = agent.episode_index,
          .episode_count = agent.episode_count,
          .episode_step = agent.state.steps()};
}
const EnvSource& BatchedEnv::source(int row) const {
  const auto& source = impl_->agent_at(row).source;
  if (!source) throw std::logic_error(fmt::format("BatchedEnv::source: agent {} has no episode", row));
  return *source;
}
NearestGoal BatchedEnv::goal(int row) const {
  static_cast<void>(source(row));
  return impl_->envs[size_of(row) / impl_->setup.per_env].run().goal_of(impl_->agent_at(row));
}
BatchCounters BatchedEnv::counters() const { return impl_->scheduler.counters(); }
QuarantineCounters BatchedEnv::quarantine_counters() const { return impl_->faults.counters(); }
void BatchedEnv::set_stage_hook(StageHook hook) { impl_->faults.set_hook(std::move(hook)); }

}  // namespace earshot
