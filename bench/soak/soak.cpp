// SPDX-License-Identifier: Apache-2.0
#include "bench/soak/soak.h"

#include <fmt/format.h>

#include <algorithm>
#include <ctime>
#include <memory>
#include <optional>
#include <thread>

#include "bench/soak/episodes.h"
#include "bench/soak/replay.h"
#include "envs/baselines/baselines.h"
#include "sim/base/errors.h"
#include "sim/base/process/progress.h"
#include "sim/base/random.h"
#include "sim/base/stopwatch.h"
#include "sim/base/temporary_folder.h"

namespace earshot {
namespace {

constexpr double kMiB = 1024.0 * 1024.0;
constexpr std::uint64_t kMemorySamples = 400, kReports = 20;
/// Scenes are walked through at least this often, so that slopes are of times when every scene has been there before.
constexpr double kWantedRounds = 4;
constexpr double kStepsPerEpisode = 120;  // about; only the number of rounds hangs on it

EnvConfig soak_env_config(const SoakOptions& options) {
  EnvConfig config;
  config.task.max_steps = 200;
  config.observation.camera.width_px = config.observation.camera.height_px = options.camera_px;
  config.observation.pointgoal = true;
  config.acoustics = acoustic_preset("fast");
  config.acoustics.rays = 24;
  config.acoustics.rir_length_s = 0.3f;
  config.sound_gain = 12.566371f;
  config.order = EpisodeOrder::once;
  config.threads = options.threads;
  config.seed = options.seed;
  config.scene_cache_gb = 1e-9 * kMiB * options.cache_mb;
  return config;
}

double process_cpu_s() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

std::uint64_t seed_of_round(std::uint64_t seed, int round) { return seed + 1'000'003u * static_cast<std::uint64_t>(round); }

/// Greedy or at random, by episode.  At random: mostly forward, rarely stop, so that episodes go on.
void choose_actions(const BatchedEnv& env, BaselineAgent& greedy, std::uint64_t round_seed, std::vector<std::int32_t>& actions) {
  greedy.act(env, actions);
  for (std::size_t row = 0; row < actions.size(); ++row) {
    const int index = static_cast<int>(row);
    if (!env.active()[row]) continue;
    const auto id = static_cast<std::uint32_t>(index), episode = static_cast<std::uint32_t>(env.agent(index).episode_count);
    if (RandomStream(round_seed, Purpose::bench, id, episode).uniform(0) < 0.5f) continue;
    const float draw =
        RandomStream(round_seed, Purpose::random_agent, id, episode, static_cast<std::uint32_t>(env.agent(index).episode_step)).uniform(1);
    const Action action = draw < 0.008f ? Action::stop : draw < 0.3f ? Action::left : draw < 0.59f ? Action::right : Action::forward;
    actions[row] = static_cast<std::int32_t>(action);
  }
}

std::array<double, kSoakStages.size()> stage_seconds(const BatchedEnv& env) {
  const StageSeconds& s = env.counters().stages;
  return {0, s.move, s.trace, s.synthesize, s.convolve, s.render, s.observe, s.reset};
}

/// The run itself: environments, watch and clock, and the result as it fills.
class Soak {
 public:
  explicit Soak(const SoakOptions& options)
      : options_(options),
        config_(soak_env_config(options)),
        cache_(make_scene_cache(config_)),
        scenes_(make_soak_scenes(options.seed, options.scenes, options.hard_every, folder_.path())) {
    result_.options = options;
    result_.threads = options.threads > 0 ? options.threads : static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
    const double episodes = static_cast<double>(options.steps) / (kWantedRounds * kStepsPerEpisode * options.scenes);
    const int at_least = (options.num_envs + options.scenes - 1) / options.scenes;  // no env idles from the start
    const int per_scene = std::clamp(static_cast<int>(episodes), at_least, 1000);
    episodes_ = make_soak_episodes(scenes_, per_scene, config_, *cache_, result_.threads, options.seed);
    result_.episodes_per_scene = static_cast<std::size_t>(per_scene);
    result_.num_episodes_in_set = episodes_.set.episodes.size();
    result_.refused_scenes = episodes_.refused;
    result_.cache_bound = options.cache_mb;
    set_ = std::make_shared<const EpisodeSet>(episodes_.set);
    env_.emplace(config_, set_, cache_, options.num_envs);
    watch_.emplace(scenes_, episodes_, config_, options.num_envs, options.replays, options.tamper);
    result_.memory.reserve(kMemorySamples + 8);
  }

  SoakResult run() {
    try {
      take_steps();
      run_again_cold();
    } catch (const std::exception& error) {
      result_.failure = error.what();
    }
    summarize();
    result_.finished = true;
    return std::move(result_);
  }

 private:
  void take_steps() {
    Progress progress("soak", "steps", options_.steps);
    std::vector<std::int32_t> actions(static_cast<std::size_t>(options_.num_envs));
    cpu_at_start_ = process_cpu_s();
    watch_time_ = Stopwatch();
    begin_round();
    sample_memory();
    while (watch_->steps() < options_.steps && watch_time_.wall_s() < 60 * options_.minutes) {
      if (std::ranges::none_of(env_->active(), [](std::uint8_t active) { return active != 0; })) {
        ++round_;
        if (round_ == 1) end_of_first_round_ = watch_->steps();
        begin_round();
      }
      choose_actions(*env_, *greedy_, seed_of_round(options_.seed, round_), actions);
      const auto before = stage_seconds(*env_);
      const Stopwatch one_step;
      env_->step(actions);
      book(one_step.wall_s(), before);
      watch_->check(*env_);
      if (watch_->steps() >= (result_.memory.size() * options_.steps) / kMemorySamples) sample_memory();
      progress.update(watch_->steps(), fmt::format("round {}, {} scenes loaded, {:.0f} MiB", round_ + 1, cache_->scenes_loaded(),
                                                   result_.memory.back().resident));
      report_in_between();
    }
    sample_memory();
  }

  void begin_round() {
    env_->reset();
    greedy_.emplace(Baseline::greedy, config_, options_.num_envs, seed_of_round(options_.seed, round_));
    watch_->check_start(*env_);
  }

  void book(double wall_s, const std::array<double, kSoakStages.size()>& before) {
    const auto after = stage_seconds(*env_);
    result_.stage_ms[0].add(1e3 * wall_s);
    for (std::size_t stage = 1; stage < after.size(); ++stage) result_.stage_ms[stage].add(1e3 * (after[stage] - before[stage]));
  }

  void sample_memory() {
    MemorySample sample{.steps = watch_->steps(), .seconds = watch_time_.wall_s()};
    read_process_memory(sample);
    sample.cache = static_cast<double>(cache_->bytes()) / kMiB;
    sample.scenes_held = cache_->num_scenes();
    sample.scenes_loaded = cache_->scenes_loaded();
    sample.sources_built = cache_->sources_built();
    sample.episodes = watch_->episodes();
    result_.memory.push_back(sample);
    result_.cpu_seconds = process_cpu_s() - cpu_at_start_;
  }

  void report_in_between() {
    if (!options_.on_progress || watch_->steps() < (reports_ + 1) * options_.steps / kReports) return;
    ++reports_;
    summarize();
    options_.on_progress(result_);
  }

  void run_again_cold() {
    Progress progress("cold replay", "episodes", watch_->records().size());
    for (const SoakRecord& record : watch_->records()) {
      const std::uint64_t hash = replay_cold(record, config_, set_, options_.num_envs);
      if (hash != record.hash) {
        ++result_.replays_that_differ;
        result_.differing.push_back(fmt::format("scene {}, env {}, its episode {}, {} steps", set_->episodes[record.episode_index].scene_id,
                                                record.env, record.episode_count, record.actions.size()));
      }
      progress.update(static_cast<std::uint64_t>(++result_.replayed));
    }
  }

  void summarize() {
    result_.steps = watch_->steps();
    result_.rounds = round_ + 1;
    result_.episodes = watch_->episodes();
    result_.successes = watch_->successes();
    if (!result_.memory.empty()) result_.seconds = result_.memory.back().seconds;
    for (std::size_t i = 0; i < kNumSoakFaults; ++i) result_.faults[i] = watch_->count(static_cast<SoakFault>(i));
    result_.examples = watch_->examples();
    result_.kinds = watch_->kinds();
    result_.loudness = watch_->loudness();
    result_.largest_reward = watch_->largest_reward();
    result_.quarantined = env_->quarantine_counters();
    result_.nonfinite_events = result_.quarantined.nonfinite();
    result_.cached_responses = env_->counters().cached_responses;
    fit_memory();
  }

  void fit_memory() {
    // Warm: every scene has been there, or, in a run of hardly more than one round, the first third is over.
    result_.all_scenes_before = end_of_first_round_ && *end_of_first_round_ <= result_.steps / 2;
    result_.warm_up_steps = result_.all_scenes_before ? *end_of_first_round_ : result_.steps / 3;
    std::vector<double> steps, resident, heap;
    for (const MemorySample& sample : result_.memory) {
      result_.largest_cache = std::max(result_.largest_cache, sample.cache);
      result_.evicted_scenes = std::max(result_.evicted_scenes, sample.scenes_loaded - std::min(sample.scenes_loaded, sample.scenes_held));
      if (sample.steps < result_.warm_up_steps) continue;
      steps.push_back(static_cast<double>(sample.steps));
      resident.push_back(sample.resident);
      heap.push_back(sample.heap_in_use);
    }
    result_.resident_slope = fit_line(steps, resident);
    result_.heap_slope = fit_line(steps, heap);
  }

  SoakOptions options_;
  EnvConfig config_;
  TemporaryFolder folder_{std::filesystem::temp_directory_path(), "earshot_soak_"};  ///< of the scenes that are files
  std::shared_ptr<SceneCache> cache_;
  std::vector<SoakScene> scenes_;
  SoakEpisodes episodes_;
  std::shared_ptr<const EpisodeSet> set_;
  std::optional<BatchedEnv> env_;
  std::optional<BaselineAgent> greedy_;  ///< of this round
  std::optional<SoakWatch> watch_;
  SoakResult result_;
  Stopwatch watch_time_;
  double cpu_at_start_ = 0;
  int round_ = 0;
  std::uint64_t reports_ = 0;
  std::optional<std::uint64_t> end_of_first_round_;
};

}  // namespace

void validate(const SoakOptions& options) {
  require(options.steps >= 1 && options.steps <= 1'000'000'000'000, "--steps", options.steps, "must be in [1, 1e12]");
  require(options.scenes >= 1 && options.scenes <= 100'000, "--scenes", options.scenes, "must be in [1, 100000]");
  require(options.hard_every >= 0, "--hard-every", options.hard_every, "must not be negative; 0: no hard scenes");
  require(options.num_envs >= 1 && options.num_envs <= 4096, "--num-envs", options.num_envs, "must be in [1, 4096]");
  require(options.threads >= 0 && options.threads <= 1024, "--threads", options.threads, "must be in [0, 1024]; 0: all cores");
  require(options.minutes > 0 && options.minutes <= 100'000, "--minutes", options.minutes, "must be in (0, 100000]");
  require(options.camera_px >= 8 && options.camera_px <= 1024 && options.camera_px % 8 == 0, "--camera-px", options.camera_px,
          "must be a multiple of 8 in [8, 1024]");
  require(options.cache_mb >= 0 && options.cache_mb <= 1e6, "--cache-mb", options.cache_mb, "must be in [0, 1e6]");
  require(options.replays >= 0 && options.replays <= 10'000, "--replays", options.replays, "must be in [0, 10000]");
  require(options.memory_limit_mib > 0 && options.memory_limit_mib <= 1e6, "--memory-limit", options.memory_limit_mib,
          "must be in (0, 1e6]");
}

SoakResult run_soak(const SoakOptions& options) {
  validate(options);
  return Soak(options).run();
}

}  // namespace earshot
