#include "envs/batch/batched_env.h"

#include <fmt/format.h>
#include <tbb/info.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <utility>

#include "envs/batch/batched_env_impl.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

StreamConfig stream_config(const EnvConfig& config, int block_samples, int head_samples) {
  const float rate_hz = config.acoustics.sample_rate_hz;
  return {.sample_rate_hz = rate_hz,
          .max_rir_samples = static_cast<int>(std::ceil(config.acoustics.rir_length_s * rate_hz)) + head_samples,
          .max_block_samples = block_samples,
          .crossfade_samples = std::min(block_samples, static_cast<int>(std::lround(config.crossfade_s * rate_hz)))};
}

}  // namespace

BatchedEnv::Impl::Impl(const EnvConfig& env_config, std::shared_ptr<const EpisodeSet> episodes, std::shared_ptr<SceneCache> cache,
                       int num_envs, int first, int total)
    : config(env_config),
      set(std::move(episodes)),
      scenes(std::move(cache)),
      first_env(first),
      total_envs(total > 0 ? total : first + num_envs),
      block_samples((validate(config), static_cast<int>(std::lround(config.acoustics.sample_rate_hz * config.task.step_time_s)))),
      oracle(set->episodes.size() * size_of(config.agents)),
      sounds(config.observation.hears() ? std::span<const Episode>(set->episodes) : std::span<const Episode>{}, config.sound_root,
             config.acoustics.sample_rate_hz, config.sound_gain),
      per_env(size_of(config.agents)),
      envs(size_of(num_envs)),
      agents(envs.size() * per_env),
      rows(config.observation, block_samples, agents.size()),
      quarantine(config.quarantine_dir) {
  require(config.accuracy.empty(), "accuracy", config.accuracy, "has to be planned before environments are made (plan_env_accuracy)");
  require(num_envs >= 1, "num_envs", num_envs, "must be at least 1");
  require(first_env >= 0 && first_env + num_envs <= total_envs, "first_env", first_env, "first_env + num_envs must not exceed total_envs");
  if (set->episodes.empty()) throw InputError("episode set", "holds no episodes", "make one with `earshot dataset episodes`");
  for (const Episode& episode : set->episodes)
    if (episode.other_agents.size() + 1 < per_env)
      throw InputError("episode '" + episode.episode_id + "' in " + episode.scene_id,
                       fmt::format("has {} agents, env.agents asks for {}", episode.other_agents.size() + 1, per_env),
                       "make the set with as many (data.train.agents.count, `earshot dataset episodes --agents`), or lower env.agents");
  EARSHOT_EXPECT(scenes->acoustics().sample_rate_hz == config.acoustics.sample_rate_hz);

  const ObservationSpec& spec = config.observation;
  for (std::size_t i = 0; const ExtraCamera& camera : spec.all_cameras()) {
    const int index = static_cast<int>(i++);
    cameras.push_back({.camera = EmbreeCamera(camera.config),
                       .depth = rows.of(SensorKind::depth, index),
                       .rgb = rows.of(SensorKind::rgb, index),
                       .semantic = rows.of(SensorKind::semantic, index),
                       .normals = rows.of(SensorKind::normals, index)});
  }
  open_renderer();

  if (spec.hears()) {
    const float rate_hz = config.acoustics.sample_rate_hz;
    const auto hrtf = config.hrtf.empty() ? Hrtf::rigid_sphere(rate_hz) : Hrtf::from_sofa(config.hrtf, rate_hz);
    const BandLayout bands =
        config.acoustics.bands > 0 ? BandLayout::log_spaced(config.acoustics.bands, rate_hz) : BandLayout::octaves(rate_hz);
    const auto tables = make_synthesis_tables(config.acoustics, bands, ChannelLayout::binaural, hrtf);
    const StreamConfig stream = stream_config(config, block_samples, hrtf->fft_size());
    const auto dry_spectra = make_dry_spectra(stream);
    const double most_speed_m_per_s = std::max(5.0, 2.0 * static_cast<double>(config.task.forward_m / config.task.step_time_s));
    make_engines = [tables, stream, sound = spec.sound, dry_spectra, most_speed_m_per_s] {
      return std::make_unique<HearingEngines>(tables, stream, sound, dry_spectra, most_speed_m_per_s);
    };
  }
  for (auto* flags : {&under_way, &is_done}) flags->assign(envs.size(), 0);
  for (Agent& agent : agents)
    agent.around = {.places = {}, .apart_m = 2 * config.navmesh.agent_radius_m, .height_m = config.navmesh.agent_height_m};
  all_envs.resize(envs.size());
  std::iota(all_envs.begin(), all_envs.end(), std::uint32_t{0});
  finished.reserve(agents.size());
  spare_actions.reserve(agents.size());
  for (EnvRun& run : envs) run.ended.reserve(per_env);
  submitted.reserve(envs.size());
  sent_order.reserve(envs.size());
  received.reserve(envs.size());
  const int threads = config.threads > 0 ? config.threads : tbb::info::default_concurrency();
  workers.emplace(std::min(threads, num_envs), envs.size(), config.stage_limit_s,
                  [this](std::size_t env, std::size_t worker) { run_task(env, worker); });
  // Threads that envs leave over share the agents of each.  A stage that is given up takes its thread with it, so with a limit there are
  // none of these.
  if (per_env > 1 && config.stage_limit_s == 0)
    helpers = std::min(size_of(threads) / envs.size(), per_env) - std::min(size_of(threads) / envs.size(), std::size_t{1});
  for (EnvRun& run : envs)
    if (helpers > 0) run.team = std::make_unique<AgentTeam>(helpers);
  engines.resize(workers->num_workers() + envs.size() * helpers);
}

std::size_t BatchedEnv::Impl::index_of(int env) const {
  if (env < 0 || size_of(env) >= envs.size())
    throw std::out_of_range(fmt::format("BatchedEnv: environment {} of a batch of {}", env, envs.size()));
  return size_of(env);
}

std::size_t BatchedEnv::Impl::row_of(int row) const {
  if (row < 0 || size_of(row) >= agents.size())
    throw std::out_of_range(fmt::format("BatchedEnv: agent {} of a batch of {}", row, agents.size()));
  return size_of(row);
}

BatchedEnv::BatchedEnv(const EnvConfig& config, std::shared_ptr<const EpisodeSet> set, std::shared_ptr<SceneCache> scenes, int num_envs,
                       int first_env, int total_envs)
    : impl_(std::make_unique<Impl>(config, std::move(set), std::move(scenes), num_envs, first_env, total_envs)) {}

BatchedEnv::~BatchedEnv() {
  // What a stage that never returns works on has to stay.
  if (impl_->workers->tasks_given_up() > 0) static_cast<void>(impl_.release());
}

std::string BatchedEnv::save_state() const {
  const Impl& in = *impl_;
  EnvState state{.set_hash = in.set->hash,
                 .seed = in.config.seed,
                 .first_env = in.first_env,
                 .total_envs = in.total_envs,
                 .started = in.started,
                 .envs = {}};
  in.refuse_while_under_way("save_state");
  for (const std::uint32_t env : in.all_envs) state.envs.push_back(in.cursor_of(env));
  return encode(state);
}

namespace {

[[noreturn]] void refuse_state(const std::string& what) {
  throw InputError("environment state", what, "resume with the set, seed and batch it was saved with");
}

}  // namespace

void BatchedEnv::Impl::check_cursor(const EnvCursor& cursor) const {
  if (cursor.active && cursor.episode_index >= set->episodes.size()) refuse_state("names an episode that the set does not have");
  if (cursor.others.size() + 1 != per_env) refuse_state("has another number of agents");
  std::size_t longest = cursor.actions.size();
  for (const auto& actions : cursor.others) longest = std::max(longest, actions.size());
  if (longest > size_of(config.task.max_steps)) refuse_state("has an episode longer than task.max_steps");
  if (cursor.ended && !cursor.is_void && config.autoreset == Autoreset::same_step)
    refuse_state("has an episode that has ended, which autoreset same_step knows none of");
}

void BatchedEnv::restore(std::string_view text) {
  Impl& in = *impl_;
  in.refuse_while_under_way("restore");
  const EnvState state = decode_env_state(text);
  if (state.set_hash != in.set->hash) refuse_state("belongs to another episode set");
  if (state.seed != in.config.seed) refuse_state("has another seed");
  if (state.envs.size() != in.envs.size() || state.first_env != in.first_env || state.total_envs != in.total_envs)
    refuse_state("belongs to another batch of environments");
  for (const EnvCursor& cursor : state.envs) in.check_cursor(cursor);
  for (const std::uint32_t env : in.all_envs) in.require_settled(env, "restore");
  in.clear_finished();
  in.started = state.started;
  if (!state.started) return;
  in.submitted.clear();
  for (const std::uint32_t env : in.all_envs) {
    in.envs[env].job = Job::restore;
    in.envs[env].cursor = state.envs[env];
    in.submitted.push_back(env);
  }
  in.run_all();
}

std::string BatchedEnv::snapshot(int env) const {
  const Impl& in = *impl_;
  const std::size_t index = in.index_of(env);
  if (in.under_way[index] != 0) throw std::logic_error(fmt::format("BatchedEnv::snapshot: environment {} is under way", env));
  return encode({.set_hash = in.set->hash,
                 .seed = in.config.seed,
                 .first_env = 0,
                 .total_envs = 1,
                 .started = in.started,
                 .envs = {in.cursor_of(index)}});
}

void BatchedEnv::restore(int env, std::string_view snapshot) {
  Impl& in = *impl_;
  in.refuse_while_under_way("restore");
  const std::size_t index = in.index_of(env);
  const EnvState state = decode_env_state(snapshot);
  if (state.set_hash != in.set->hash) refuse_state("belongs to another episode set");
  if (state.envs.size() != 1 || !state.started) refuse_state("is no snapshot of one environment with an episode");
  if (!in.started) throw std::logic_error("BatchedEnv::restore: no episode has begun, reset all environments first");
  in.check_cursor(state.envs.front());
  in.require_settled(index, "restore");
  in.envs[index].job = Job::restore;
  in.envs[index].cursor = state.envs.front();
  in.submitted.assign(1, static_cast<std::uint32_t>(index));
  in.run_all();
}

int BatchedEnv::num_envs() const { return impl_->num_envs(); }
int BatchedEnv::num_agents() const { return static_cast<int>(impl_->per_env); }
int BatchedEnv::num_rows() const { return static_cast<int>(impl_->agents.size()); }
const EnvConfig& BatchedEnv::config() const { return impl_->config; }
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
std::span<const FinishedEpisode> BatchedEnv::finished() const { return impl_->finished; }

Pose BatchedEnv::pose(int row) const { return impl_->agents[impl_->row_of(row)].state.pose(impl_->config.task); }
const EnvSource& BatchedEnv::source(int row) const {
  const auto& source = impl_->agents[impl_->row_of(row)].source;
  if (!source) throw std::logic_error(fmt::format("BatchedEnv::source: agent {} has no episode", row));
  return *source;
}
NearestGoal BatchedEnv::goal(int row) const {
  static_cast<void>(source(row));
  return impl_->goal_of(impl_->row_of(row));
}
std::uint64_t BatchedEnv::episode_index(int row) const { return impl_->agents[impl_->row_of(row)].episode_index; }
int BatchedEnv::episode_count(int row) const { return impl_->agents[impl_->row_of(row)].episode_count; }
int BatchedEnv::episode_step(int row) const { return impl_->agents[impl_->row_of(row)].state.steps(); }
const StageSeconds& BatchedEnv::stage_seconds() const { return impl_->stage_seconds; }
EffectCounters BatchedEnv::effect_counters() const {
  EffectCounters sum;
  for (const Agent& agent : impl_->agents) sum.add(agent.hearing.effects());
  return sum;
}
std::uint64_t BatchedEnv::cached_responses() const {
  std::uint64_t sum = 0;
  for (const Agent& agent : impl_->agents) sum += agent.hearing.cached_responses();
  return sum;
}
QuarantineCounters BatchedEnv::quarantine_counters() const { return impl_->quarantine.counters(); }
std::uint64_t BatchedEnv::nonfinite_events() const {
  const QuarantineCounters counters = quarantine_counters();
  std::uint64_t sum = 0;
  for (const Fault fault :
       {Fault::distance, Fault::reward, Fault::pose, Fault::depth, Fault::rir, Fault::sound, Fault::spectrogram, Fault::pointgoal})
    sum += counters.of(fault);
  return sum;
}
std::uint64_t BatchedEnv::skipped_episodes() const { return quarantine_counters().of(Fault::path); }
void BatchedEnv::set_stage_hook(StageHook hook) { impl_->hook = std::move(hook); }

std::optional<FaultReport> BatchedEnv::begin(int env, std::uint64_t episode_index, int episode_count) {
  Impl& in = *impl_;
  in.refuse_while_under_way("begin");
  const std::size_t index = in.index_of(env);
  if (episode_index >= in.set->episodes.size() || episode_count < 0)
    throw std::invalid_argument(
        fmt::format("BatchedEnv::begin: episode {} of {}, number {}", episode_index, in.set->episodes.size(), episode_count));
  in.require_settled(index, "begin");
  in.envs[index].job = Job::begin;
  in.seed_env(index, in.config.seed, in.global_id(index));
  for (Agent& agent : in.agents_of(index)) {
    agent.episode_index = episode_index;
    agent.episode_count = episode_count;
  }
  in.started = true;
  in.submitted.assign(1, static_cast<std::uint32_t>(env));
  in.run_all();
  const FaultReport* found = in.fault_of(index);
  if (!found) return std::nullopt;
  const FaultReport fault = *found;
  in.go_idle(index);
  in.publish(index);
  return fault;
}

}  // namespace earshot
