#pragma once

// The inside of BatchedEnv, shared by its files: batched_env.cpp (construction, state that can be asked for), env_stepping.cpp (how tasks
// of envs are started and gathered), env_stages.cpp (what a step does for one env), env_pictures.cpp (its cameras), env_episodes.cpp (how
// episodes begin, end and are restored) and env_faults.cpp (how they are quarantined).

#include <array>
#include <atomic>
#include <chrono>
#include <exception>
#include <new>

#include "envs/agent_hearing.h"
#include "envs/batched_env.h"
#include "envs/env_state.h"
#include "envs/env_workers.h"
#include "envs/oracle_counts.h"
#include "envs/pending_pictures.h"
#include "envs/sensor_rows.h"
#include "envs/sound_library.h"
#include "sim/base/denormals.h"
#include "sim/base/errors.h"
#include "sim/vision/egl_renderer.h"
#include "sim/vision/embree_camera.h"

namespace earshot {

enum Stage : std::size_t {
  move_stage,
  trace_stage,
  synthesize_stage,
  convolve_stage,
  render_stage,
  observe_stage,
  reset_stage,
  num_stages
};

inline constexpr std::array<double StageSeconds::*, num_stages> kStageSeconds{
    &StageSeconds::move,   &StageSeconds::trace,   &StageSeconds::synthesize, &StageSeconds::convolve,
    &StageSeconds::render, &StageSeconds::observe, &StageSeconds::reset};

/// What an env's next task does.
enum class Job : std::uint8_t {
  step,     ///< the action, or the next episode where one has ended and `next_step` begins it
  first,    ///< the first episode of its sequence
  next,     ///< the next one
  begin,    ///< the episode that the agent's index and count name
  restore,  ///< what the cursor says
};

/// Everything that belongs to one agent and is not an observation.
struct Agent {
  Job job = Job::step;
  Action action = Action::stop;
  EnvCursor cursor;  // of Job::restore

  std::uint64_t seed = 0;    // of the draws of its episodes
  std::uint32_t stream = 0;  // which sequence of that seed
  bool pictures_are_current = false;
  std::shared_ptr<const Appearance> appearance;  // of its scene, where a camera wants colours or categories
  std::vector<float> clean_depth;                // of one camera, before its noise
  PendingPictures pictures_now, pictures_last;   // by EGL: of the rows now, and of the last ones of an episode that has just ended
  std::uint64_t episode_index = 0;
  int episode_count = -1;                                 // none begun
  std::shared_ptr<const EnvSource> source;                // of the goal
  std::vector<std::shared_ptr<const EnvSource>> playing;  // sources of the episode, where it names them
  std::vector<GeodesicField> other_goals;
  std::vector<PlayedSound> played;  // what they play; here so that its storage is kept
  AvNavState state;
  AgentHearing hearing;
  Pose start_pose, rendered_pose;
  std::vector<glm::vec3> path, goals;          // of the map: where it has been, and foot points of the goals
  std::vector<std::int8_t> actions;            // since the start of the episode
  std::optional<FaultReport> fault;            // of this episode: its stages are skipped until it is quarantined, in this very step
  int faulty_in_a_row = 0;                     // episodes that went wrong in a step, since one that did not
  bool has_ended = false;                      // its episode, and no other has begun
  bool stalled = false;                        // a task of it was given up and still runs
  bool comes_back = false;                     // its next task is the first since
  std::size_t worker = 0;                      // that runs its task
  std::optional<FinishedEpisode> stalled_one;  // order `once`: the episode of that task
  std::optional<FinishedEpisode> ended;        // in this task
  std::vector<std::int8_t> spare_actions;      // storage for the actions of the next one that ends
  std::vector<FinishedEpisode> failed_starts;  // order `once`: not yet among the finished
  std::exception_ptr error;                    // that ends the call
  std::uint32_t tasks = 0;
  std::array<double, num_stages> seconds{};
};

inline std::size_t size_of(int count) { return static_cast<std::size_t>(count); }

/// A camera and the rows that it fills; null: not wanted.
struct AgentCamera {
  EmbreeCamera camera;
  SensorRows *depth = nullptr, *rgb = nullptr, *semantic = nullptr, *normals = nullptr;
  bool by_egl = false;  ///< as long as EGL draws at all
};

/// Pictures of a row that wait for the next draw.
struct PendingRow {
  std::uint32_t env = 0;
  bool last = false;  ///< of the final rows
  PendingPictures* pictures = nullptr;
};

struct BatchedEnv::Impl {
  EnvConfig config;
  std::shared_ptr<const EpisodeSet> set;
  std::shared_ptr<SceneCache> scenes;
  int first_env, total_envs;
  int block_samples;
  OracleCounts oracle;
  SoundLibrary sounds;
  std::vector<AgentCamera> cameras;
  std::unique_ptr<EglRenderer> egl;    // null: Embree draws all
  std::atomic<bool> egl_draws{false};  // until it fails
  std::vector<PendingRow> pending;     // of one draw, as the next two
  std::vector<EglView> views;          // of one camera
  std::vector<float> pending_depth;    // before its noise
  std::vector<Agent> agents;
  bool started = false;

  std::vector<SensorSpec> table;
  std::vector<std::unique_ptr<SensorRows>> sensor_rows;  // as the table, then what is kept without being observed
  SensorRows *depth = nullptr, *spectrogram = nullptr, *waveform = nullptr, *heard = nullptr;
  SensorRows *pointgoal = nullptr, *gps_compass = nullptr, *way = nullptr, *collision = nullptr, *previous_action = nullptr,
             *topdown_map = nullptr;
  std::vector<float> rewards;
  std::vector<std::uint8_t> terminated, truncated, active, collided, quarantined;
  std::vector<FinishedEpisode> finished;
  std::vector<std::vector<std::int8_t>> spare_actions;  // of those that were finished before
  StageSeconds stage_seconds;
  Quarantine quarantine;
  StageHook hook;
  std::atomic<std::uint64_t> begun{0}, failed{0};  // episodes

  std::function<std::unique_ptr<HearingEngines>()> make_engines;  // empty: no env hears
  std::vector<std::unique_ptr<HearingEngines>> engines;           // by worker, made by it
  std::vector<std::uint32_t> all_envs, submitted, sent_order;
  std::vector<std::int32_t> received;
  std::vector<std::uint8_t> under_way, is_done;  // by env: sent and not handed back; done and not handed back
  std::optional<EnvWorkers> workers;             // last: its threads use what is above

  Impl(const EnvConfig& env_config, std::shared_ptr<const EpisodeSet> episodes, std::shared_ptr<SceneCache> cache, int num_envs, int first,
       int total);

  int num_envs() const { return static_cast<int>(agents.size()); }
  std::uint32_t global_id(std::size_t env) const { return static_cast<std::uint32_t>(first_env) + static_cast<std::uint32_t>(env); }
  bool ended(std::size_t env) const { return terminated[env] || truncated[env]; }
  /// Whether the env has an episode that goes on.
  bool runs(std::size_t env) const { return active[env] && !agents[env].fault; }
  const Episode& episode_of(const Agent& agent) const { return set->episodes[agent.episode_index]; }
  std::size_t index_of(int env) const;

  // Tasks (env_stepping.cpp).
  HearingEngines* engines_of(std::size_t worker);
  void run_task(std::size_t env, std::size_t worker);
  void step_task(std::size_t env, HearingEngines* own);
  /// Runs the tasks of `submitted` and gathers what came of them.
  void run_all();
  void settle(CompletedEnv completed);
  void gather(std::span<const std::uint32_t> envs);
  void clear_finished();
  void gather_failed_starts(std::span<const std::uint32_t> envs);
  bool wants_task(std::size_t env);
  /// Throws std::logic_error where the thread of a stalled env still uses it.
  void require_settled(std::size_t env, const char* call);
  /// False: the task of the env has been given up; its thread must leave the env alone.
  bool goes_on(std::size_t env);
  void check_action(std::size_t env, std::int32_t action) const;
  void refuse_while_under_way(const char* call) const;
  /// body() with every exception turned into a fault of the env's episode.
  template <class Body>
  void guarded(std::size_t env, Fault kind, const Body& body);

  // The stages of a step; each reads poses and writes one row of its buffers.  own: engines of this thread, null for an agent that does
  // not hear.
  void move(std::size_t env, Action action);
  /// block: samples that are heard with what is traced.
  void trace(std::size_t env, HearingEngines* own, int block);
  void synthesize(std::size_t env, HearingEngines* own);
  void convolve(std::size_t env, HearingEngines* own);
  /// Draws, or leaves what EGL shall draw with other envs' to draw_pending().
  void render(std::size_t env);
  void observe(std::size_t env, HearingEngines* own);
  void observe_way(std::size_t env);
  void add_pose_noise(const Agent& agent, std::span<float> reading) const;

  // Pictures of many envs at once (env_pictures.cpp).
  void open_renderer();
  /// Draws what the tasks of these envs have left.
  void draw_pending(std::span<const std::uint32_t> envs);
  void draw_pending_of(std::size_t index);
  void draw_by_egl(const CameraSensorConfig& view_config);
  /// The observation now becomes the last one of the episode.
  void keep_rows(std::size_t env);

  std::optional<std::uint64_t> draw_episode(std::size_t env, int episode_count, std::uint32_t attempt) const;
  void begin_next_episode(std::size_t env, HearingEngines* own);
  /// Sets the agent's fault if the episode cannot begin.
  void begin_episode(std::size_t env, std::uint64_t episode_index, int episode_count, HearingEngines* own);
  void prepare_episode(std::size_t env, std::uint64_t episode_index, int episode_count);
  void enter_episode(std::size_t env);
  void go_idle(std::size_t env);
  void observe_start(std::size_t env, HearingEngines* own);
  [[nodiscard]] NearestGoal goal_of(const Agent& agent) const;
  void begin_hearing(std::size_t env);
  void restore(std::size_t env, const EnvCursor& cursor, HearingEngines* own);
  [[nodiscard]] EnvCursor cursor_of(std::size_t env) const;
  void check_cursor(const EnvCursor& cursor) const;
  void end_episode(std::size_t env);
  /// Notes a fault of the running episode; the first one stays.
  void report(std::size_t env, Fault fault, std::string detail);
  /// Calls the hook with `values`, then reports the fault if one is not finite.
  bool check(std::size_t env, Fault kind, std::span<float> values);
  void clear_rows(std::size_t env);
  void clear_outcome(std::size_t env);
  void quarantine_episode(std::size_t env, const FaultReport& fault);
  FinishedEpisode failed_episode(std::size_t env, const FaultReport& fault) const;
  void end_faulty_episode(std::size_t env);
  void quarantine_stalled(std::size_t env);
  void stop_if_none_begins() const;
};

template <class Body>
void BatchedEnv::Impl::guarded(std::size_t env, Fault kind, const Body& body) {
  try {
    body();
  } catch (const std::bad_alloc&) {
    report(env, kind, "out of memory");
  } catch (const std::exception& error) {
    report(env, kind, error.what());
  } catch (...) {
    report(env, kind, "an exception of a type that is not known");
  }
}

}  // namespace earshot
