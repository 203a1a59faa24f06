#include "envs/batched_env.h"

#include <fmt/format.h>
#include <tbb/info.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <stdexcept>
#include <utility>

#include "envs/batched_env_impl.h"
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

/// What a caller can get wrong in step().
void check_step(bool started, std::span<const std::int32_t> actions, std::span<const std::uint8_t> active) {
  if (!started) throw std::logic_error("BatchedEnv::step: no episode has begun, call reset() first");
  if (actions.size() != active.size())
    throw std::invalid_argument(fmt::format("BatchedEnv::step: {} actions for {} environments", actions.size(), active.size()));
  for (std::size_t env = 0; env < actions.size(); ++env)
    if (active[env] != 0 && (actions[env] < 0 || actions[env] >= kNumActions))
      throw std::invalid_argument(
          fmt::format("BatchedEnv::step: action {} of environment {} is not in [0, {})", actions[env], env, kNumActions));
}

template <class Agents>
auto& agent_of(Agents& agents, int env) {
  if (env < 0 || size_of(env) >= agents.size())
    throw std::out_of_range(fmt::format("BatchedEnv: environment {} of a batch of {}", env, agents.size()));
  return agents[size_of(env)];
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
      oracle(set->episodes.size()),
      sounds(config.observation.spectrogram ? std::span<const Episode>(set->episodes) : std::span<const Episode>{}, config.sound_root,
             config.acoustics.sample_rate_hz, config.sound_gain),
      renderer(config.observation.camera),
      agents(size_of(num_envs)),
      quarantine(config.quarantine_dir) {
  require(config.accuracy.empty(), "accuracy", config.accuracy, "has to be planned before environments are made (plan_env_accuracy)");
  require(num_envs >= 1, "num_envs", num_envs, "must be at least 1");
  require(first_env >= 0 && first_env + num_envs <= total_envs, "first_env", first_env, "first_env + num_envs must not exceed total_envs");
  if (set->episodes.empty()) throw InputError("episode set", "holds no episodes", "make one with `earshot dataset episodes`");
  EARSHOT_EXPECT(scenes->acoustics().sample_rate_hz == config.acoustics.sample_rate_hz);

  const ObservationSpec& spec = config.observation;
  if (spec.depth) depth.resize(num_envs, spec.depth_size());
  if (spec.pointgoal) pointgoal.resize(num_envs, 2);
  const int threads = config.threads > 0 ? config.threads : tbb::info::default_concurrency();
  if (threads > 1) arena.emplace(threads);
  if (spec.spectrogram) {
    spectrogram.resize(num_envs, spec.spectrogram_size());
    audiogoal.assign(size_of(num_envs) * 2 * size_of(block_samples), 0.f);
    heard.assign(size_of(num_envs) * 2 * size_of(spec.sound.num_samples), 0.f);
    const float rate_hz = config.acoustics.sample_rate_hz;
    const auto hrtf = config.hrtf.empty() ? Hrtf::rigid_sphere(rate_hz) : Hrtf::from_sofa(config.hrtf, rate_hz);
    const BandLayout bands =
        config.acoustics.bands > 0 ? BandLayout::log_spaced(config.acoustics.bands, rate_hz) : BandLayout::octaves(rate_hz);
    const auto tables = make_synthesis_tables(config.acoustics, bands, ChannelLayout::binaural, hrtf);
    const StreamConfig stream = stream_config(config, block_samples, hrtf->fft_size());
    const auto dry_spectra = make_dry_spectra(stream);
    const double most_speed_m_per_s = std::max(5.0, 2.0 * static_cast<double>(config.task.forward_m / config.task.step_time_s));
    for (int thread = 0; thread < threads; ++thread) engines.emplace_back(tables, stream, spec.sound, dry_spectra, most_speed_m_per_s);
  }
  rewards.assign(agents.size(), 0.f);
  for (auto* flags : {&terminated, &truncated, &active, &collided, &quarantined}) flags->assign(agents.size(), 0);
  finished.reserve(agents.size());
}

void BatchedEnv::Impl::book_stage_seconds() {
  std::array<double, num_stages> sum{};
  for (const Agent& agent : agents)
    for (std::size_t stage = 0; stage < num_stages; ++stage) sum[stage] += agent.seconds[stage];
  stage_seconds = {.move = sum[move_stage],
                   .trace = sum[trace_stage],
                   .synthesize = sum[synthesize_stage],
                   .convolve = sum[convolve_stage],
                   .render = sum[render_stage],
                   .observe = sum[observe_stage],
                   .reset = sum[reset_stage]};
}

BatchedEnv::BatchedEnv(const EnvConfig& config, std::shared_ptr<const EpisodeSet> set, std::shared_ptr<SceneCache> scenes, int num_envs,
                       int first_env, int total_envs)
    : impl_(std::make_unique<Impl>(config, std::move(set), std::move(scenes), num_envs, first_env, total_envs)) {}

BatchedEnv::~BatchedEnv() = default;

void BatchedEnv::reset() {
  Impl& in = *impl_;
  in.finished.clear();
  for (auto* flags : {&in.terminated, &in.truncated, &in.collided, &in.quarantined}) std::ranges::fill(*flags, std::uint8_t{0});
  std::ranges::fill(in.rewards, 0.f);
  for (Agent& agent : in.agents) {
    agent.episode_count = -1;
    agent.failed_starts.clear();
  }
  in.for_each_env(reset_stage, [&](std::size_t env, HearingEngines* own) { in.begin_next_episode(env, own); });
  in.started = true;
  in.stop_if_none_begins();
  in.book_stage_seconds();
}

void BatchedEnv::step(std::span<const std::int32_t> actions) {
  Impl& in = *impl_;
  check_step(in.started, actions, in.active);
  in.finished.clear();
  in.for_each_env(move_stage, [&](std::size_t env, HearingEngines*) { in.move(env, static_cast<Action>(actions[env])); });
  in.for_each_running_env(trace_stage, [&](std::size_t env, HearingEngines*) { in.trace(env); });
  in.for_each_running_env(synthesize_stage, [&](std::size_t env, HearingEngines* own) { in.synthesize(env, own); });
  in.for_each_running_env(convolve_stage, [&](std::size_t env, HearingEngines* own) { in.convolve(env, own); });
  in.for_each_running_env(render_stage, [&](std::size_t env, HearingEngines*) { in.render(env); });
  in.for_each_running_env(observe_stage, [&](std::size_t env, HearingEngines* own) { in.observe(env, own); });
  for (std::size_t env = 0; env < in.agents.size(); ++env) in.end_faulty_episode(env);
  if (in.collect_finished()) in.for_each_env(reset_stage, [&](std::size_t env, HearingEngines* own) { in.restart(env, own); });
  for (Agent& agent : in.agents) {
    std::ranges::move(agent.failed_starts, std::back_inserter(in.finished));
    agent.failed_starts.clear();
  }
  in.stop_if_none_begins();
  in.book_stage_seconds();
}

std::string BatchedEnv::save_state() const {
  const Impl& in = *impl_;
  EnvState state{.set_hash = in.set->hash,
                 .seed = in.config.seed,
                 .first_env = in.first_env,
                 .total_envs = in.total_envs,
                 .started = in.started,
                 .envs = {}};
  for (std::size_t env = 0; env < in.agents.size(); ++env) {
    const Agent& agent = in.agents[env];
    state.envs.push_back({.active = in.active[env] != 0,
                          .episode_index = agent.episode_index,
                          .episode_count = std::max(0, agent.episode_count),
                          .actions = agent.actions});
  }
  return encode(state);
}

void BatchedEnv::restore(std::string_view text) {
  Impl& in = *impl_;
  const EnvState state = decode_env_state(text);
  const auto refuse = [](const std::string& what) {
    throw InputError("environment state", what, "resume with the set, seed and batch it was saved with");
  };
  if (state.set_hash != in.set->hash) refuse("belongs to another episode set");
  if (state.seed != in.config.seed) refuse("has another seed");
  if (state.envs.size() != in.agents.size() || state.first_env != in.first_env || state.total_envs != in.total_envs)
    refuse("belongs to another batch of environments");
  for (const EnvCursor& cursor : state.envs) {
    if (cursor.active && cursor.episode_index >= in.set->episodes.size()) refuse("names an episode that the set does not have");
    if (cursor.actions.size() > size_of(in.config.task.max_steps)) refuse("has an episode longer than task.max_steps");
  }
  in.finished.clear();
  in.started = state.started;
  if (!state.started) return;
  in.for_each_env(reset_stage, [&](std::size_t env, HearingEngines* own) { in.restore(env, state.envs[env], own); });
  in.book_stage_seconds();
}

int BatchedEnv::num_envs() const { return impl_->num_envs(); }
const EnvConfig& BatchedEnv::config() const { return impl_->config; }
std::span<const float> BatchedEnv::depth() const { return impl_->depth.now; }
std::span<const float> BatchedEnv::spectrogram() const { return impl_->spectrogram.now; }
std::span<const float> BatchedEnv::audiogoal() const { return impl_->audiogoal; }
std::span<const float> BatchedEnv::heard() const { return impl_->heard; }
std::span<const float> BatchedEnv::pointgoal() const { return impl_->pointgoal.now; }
std::span<const float> BatchedEnv::rewards() const { return impl_->rewards; }
std::span<const std::uint8_t> BatchedEnv::terminated() const { return impl_->terminated; }
std::span<const std::uint8_t> BatchedEnv::truncated() const { return impl_->truncated; }
std::span<const std::uint8_t> BatchedEnv::active() const { return impl_->active; }
std::span<const std::uint8_t> BatchedEnv::collided() const { return impl_->collided; }
std::span<const std::uint8_t> BatchedEnv::quarantined() const { return impl_->quarantined; }
std::span<const float> BatchedEnv::final_depth() const { return impl_->depth.last; }
std::span<const float> BatchedEnv::final_spectrogram() const { return impl_->spectrogram.last; }
std::span<const float> BatchedEnv::final_pointgoal() const { return impl_->pointgoal.last; }
std::span<const FinishedEpisode> BatchedEnv::finished() const { return impl_->finished; }

Pose BatchedEnv::pose(int env) const { return agent_of(impl_->agents, env).state.pose(impl_->config.task); }
const EnvSource& BatchedEnv::source(int env) const {
  const auto& source = agent_of(impl_->agents, env).source;
  if (!source) throw std::logic_error(fmt::format("BatchedEnv::source: no episode runs in environment {}", env));
  return *source;
}
std::uint64_t BatchedEnv::episode_index(int env) const { return agent_of(impl_->agents, env).episode_index; }
int BatchedEnv::episode_count(int env) const { return agent_of(impl_->agents, env).episode_count; }
int BatchedEnv::episode_step(int env) const { return agent_of(impl_->agents, env).state.steps(); }
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
  return counters.total() - counters.of(Fault::scene) - counters.of(Fault::path) - counters.of(Fault::stage);
}
std::uint64_t BatchedEnv::skipped_episodes() const { return quarantine_counters().of(Fault::path); }
void BatchedEnv::set_stage_hook(StageHook hook) { impl_->hook = std::move(hook); }

std::optional<FaultReport> BatchedEnv::begin(int env, std::uint64_t episode_index, int episode_count) {
  Impl& in = *impl_;
  agent_of(in.agents, env);
  if (episode_index >= in.set->episodes.size() || episode_count < 0)
    throw std::invalid_argument(
        fmt::format("BatchedEnv::begin: episode {} of {}, number {}", episode_index, in.set->episodes.size(), episode_count));
  const std::size_t row = size_of(env);
  in.finished.clear();
  in.rewards[row] = 0.f;
  in.terminated[row] = in.truncated[row] = in.collided[row] = in.quarantined[row] = 0;
  in.for_each_env(reset_stage, [&](std::size_t index, HearingEngines* own) {
    if (index == row) in.begin_episode(row, episode_index, episode_count, own);
  });
  in.started = true;
  std::optional<FaultReport> fault = in.agents[row].fault;
  if (fault) in.go_idle(row);
  in.book_stage_seconds();
  return fault;
}

}  // namespace earshot
