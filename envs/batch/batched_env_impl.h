#pragma once

// The inside of BatchedEnv, shared by its files.  An env is a scene with an episode and per_env agents; a row is one agent of one env, row
// = env * per_env + agent.  batched_env.cpp: construction, state that can be asked for.  env_calls.cpp: reset, step, send and recv.
// env_stepping.cpp: how tasks of envs are run and gathered.  env_stages.cpp: what a step does for one agent.  env_pictures.cpp: its
// cameras. env_episodes.cpp: how episodes begin.  env_restore.cpp: how they are saved, and gone on with.  env_faults.cpp: how they are
// quarantined.

#include <array>
#include <atomic>
#include <chrono>
#include <exception>
#include <new>

#include "envs/batch/agent_team.h"
#include "envs/batch/batch_rows.h"
#include "envs/batch/batched_env.h"
#include "envs/batch/env_state.h"
#include "envs/batch/env_workers.h"
#include "envs/hearing/agent_hearing.h"
#include "envs/hearing/sound_library.h"
#include "envs/sensors/pending_pictures.h"
#include "envs/task/oracle_counts.h"
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

class StageClock;  // env_stepping.cpp

/// What an env's next task does.
enum class Job : std::uint8_t {
  step,     ///< the action, or the next episode where one has ended and `next_step` begins it
  first,    ///< the first episode of its sequence
  next,     ///< the next one
  begin,    ///< the episode that the agent's index and count name
  restore,  ///< what the cursor says
};

/// A sound of an episode as its agents hear it.
struct EnvSound {
  PlayedSound played;
  std::unique_ptr<MovingSource> moving;  // null: at rest
  int agent = -1;                        // that makes it and does not hear it; -1: none
  std::exception_ptr error = nullptr;    // of its last move
};

/// What belongs to one env: what its agents share, and the state of its task.
struct EnvRun {
  Job job = Job::step;
  EnvCursor cursor;                                       // of Job::restore
  bool has_episode = false;                               // false: idle
  std::vector<std::shared_ptr<const EnvSource>> playing;  // sources of the episode, where it names them
  std::vector<EnvSound> sounds;                           // of the episode, then those of its agents
  std::vector<PlayedSound> played;                        // what one of them hears; here so that its storage is kept
  std::vector<GeodesicField> other_goals;
  int steps = 0;                               // of the episode
  int faulty_in_a_row = 0;                     // episodes that went wrong in a step, since one that did not
  bool has_ended = false;                      // its episode, and no other has begun
  bool is_void = false;                        // that episode was quarantined
  bool stalled = false;                        // a task of it was given up and still runs
  bool comes_back = false;                     // its next task is the first since
  std::size_t worker = 0;                      // that runs its task
  std::vector<FinishedEpisode> stalled_ones;   // order `once`: of the episode of that task, by agent
  std::vector<FinishedEpisode> ended;          // in this task, by agent
  std::vector<FinishedEpisode> failed_starts;  // order `once`: not yet among the finished
  std::exception_ptr error;                    // that ends the call
  std::uint32_t tasks = 0;
  std::unique_ptr<AgentTeam> team;  // null: one thread does all of its agents
};

/// Everything that belongs to one agent and is not an observation.
struct Agent {
  Action action = Action::stop;
  // The same for all agents of an env.
  std::uint64_t seed = 0;    // of the draws of its episodes
  std::uint32_t stream = 0;  // which sequence of that seed
  std::uint64_t episode_index = 0;
  int episode_count = -1;                        // none begun
  std::shared_ptr<const EnvSource> source;       // of the goal
  std::shared_ptr<const Appearance> appearance;  // of its scene, where a camera wants colours or categories

  AvNavState state;
  StepOutcome outcome;  // until the task ends: rows belong to the batch from the moment in which it gives a task up
  bool waits = false;   // its part of the episode has ended, and others go on
  AgentHearing hearing;
  bool pictures_are_current = false;
  Pose start_pose, rendered_pose;
  std::vector<glm::vec3> path, goals;              // of the map: where it has been, and foot points of the goals
  BodiesAround around;                             // of the others, as it walks
  std::vector<AgentBody> others, rendered_others;  // as it sees them
  std::vector<float> clean_depth;                  // of one camera, before its noise
  PendingPictures pictures_now, pictures_last;     // by EGL: of the rows now, and of the last ones of an episode that has just ended
  std::vector<std::int8_t> spare_actions;          // storage for the actions of its next episode that ends
  std::vector<std::int8_t> actions;                // since the start of the episode; a step's is there before its task begins
  std::optional<FaultReport> fault;                // of this episode: its stages are skipped until it is quarantined, in this very step
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
  std::size_t per_env;                 // agents
  std::vector<EnvRun> envs;            // [num_envs]
  std::vector<Agent> agents;           // by row: [num_envs * per_env]
  bool started = false;

  BatchRows rows;
  std::vector<FinishedEpisode> finished;
  std::vector<std::vector<std::int8_t>> spare_actions;  // of those that were finished before
  StageSeconds stage_seconds;
  Quarantine quarantine;
  StageHook hook;
  std::atomic<std::uint64_t> begun{0}, failed{0};  // episodes

  std::function<std::unique_ptr<HearingEngines>()> make_engines;  // empty: no env hears
  std::vector<std::unique_ptr<HearingEngines>> engines;           // by worker, then of teams by env and helper; made by it
  std::size_t helpers = 0;                                        // of each env's team
  std::vector<std::uint32_t> all_envs, submitted, sent_order;
  std::vector<std::int32_t> received;
  std::vector<std::uint8_t> under_way, is_done;  // by env: sent and not handed back; done and not handed back
  std::optional<EnvWorkers> workers;             // last: its threads use what is above

  Impl(const EnvConfig& env_config, std::shared_ptr<const EpisodeSet> episodes, std::shared_ptr<SceneCache> cache, int num_envs, int first,
       int total);

  int num_envs() const { return static_cast<int>(envs.size()); }
  std::uint32_t global_id(std::size_t env) const { return static_cast<std::uint32_t>(first_env) + static_cast<std::uint32_t>(env); }
  std::size_t first_row(std::size_t env) const { return env * per_env; }
  std::size_t env_of(std::size_t row) const { return row / per_env; }
  int agent_of(std::size_t row) const { return static_cast<int>(row % per_env); }
  std::span<Agent> agents_of(std::size_t env) { return std::span(agents).subspan(first_row(env), per_env); }
  std::span<const Agent> agents_of(std::size_t env) const { return std::span(agents).subspan(first_row(env), per_env); }
  bool ended(std::size_t row) const { return agents[row].state.terminated() || agents[row].state.truncated(); }
  /// Whether the agent acts and observes.
  bool runs(std::size_t row) const { return envs[env_of(row)].has_episode && !agents[row].waits && !agents[row].fault; }
  /// Of the first agent that has one; null: none has.
  const FaultReport* fault_of(std::size_t env) const;
  const Episode& episode_of(const Agent& agent) const { return set->episodes[agent.episode_index]; }
  std::size_t index_of(int env) const;
  std::size_t row_of(int row) const;

  // Tasks (env_stepping.cpp, env_calls.cpp).
  HearingEngines* engines_of(std::size_t worker);
  void run_task(std::size_t env, std::size_t worker);
  void step_task(std::size_t env, HearingEngines* own);
  void begin_task(std::size_t env, HearingEngines* own);
  /// body(row, engines) for all agents of the env, by its team where it has one.  False where body was, which no team's is: the task has
  /// been given up.
  template <class Body>
  bool for_agents(std::size_t env, HearingEngines* own, const Body& body);
  /// The stages of one agent after all have moved.  False: the task has been given up.
  bool sense(std::size_t row, HearingEngines* own, StageClock& clock);
  /// Makes the outcomes of the env's agents its rows of flags and rewards.
  void publish(std::size_t env);
  /// Takes the actions of the env's agents [per_env] for its next step.
  void take_actions(std::size_t env, std::span<const std::int32_t> actions);
  /// Runs the tasks of `submitted` and gathers what came of them.
  void run_all();
  void settle(CompletedEnv completed);
  void gather(std::span<const std::uint32_t> done);
  void clear_finished();
  void gather_failed_starts(std::span<const std::uint32_t> done);
  void seed_env(std::size_t env, std::uint64_t seed, std::uint32_t stream);
  bool wants_task(std::size_t env);
  /// Throws std::logic_error where the thread of a stalled env still uses it.
  void require_settled(std::size_t env, const char* call);
  /// False: the task of the env has been given up; its thread must leave the env alone.
  bool goes_on(std::size_t env);
  void check_action(std::size_t row, std::int32_t action) const;
  void refuse_while_under_way(const char* call) const;
  /// body() with every exception turned into a fault of the agent's episode.
  template <class Body>
  void guarded(std::size_t row, Fault kind, const Body& body);

  // The stages of a step; each reads poses and writes one row of its buffers.  own: engines of this thread, null for an agent that does
  // not hear.
  void move(std::size_t row, Action action);
  /// Sounds that move to where they are at the end of a step, once for all agents.
  void move_sounds(std::size_t env, HearingEngines* own);
  /// block: samples that are heard with what is traced.
  void trace(std::size_t row, HearingEngines* own, int block);
  void synthesize(std::size_t row, HearingEngines* own);
  void convolve(std::size_t row, HearingEngines* own);
  /// Draws, or leaves what EGL shall draw with other envs' to draw_pending().
  void render(std::size_t row);
  /// The other agents of its env, as it sees them.
  void see_others(std::size_t row);
  void observe(std::size_t row, HearingEngines* own);
  void observe_way(std::size_t row);
  void observe_goal(std::size_t row);
  void add_pose_noise(std::size_t row, std::span<float> reading) const;
  /// Of the draws of one agent: each has noise of its own.
  [[nodiscard]] std::uint64_t noise_seed(std::size_t row) const {
    return agents[row].seed + (static_cast<std::uint64_t>(agent_of(row)) << 56);
  }

  // Pictures of many envs at once (env_pictures.cpp).
  void open_renderer();
  /// Draws what the tasks of these envs have left.
  void draw_pending(std::span<const std::uint32_t> done);
  void draw_pending_of(std::size_t index);
  void draw_by_egl(const CameraSensorConfig& view_config);
  /// The observation now becomes the last one of the episode.
  void keep_rows(std::size_t row);

  std::optional<std::uint64_t> draw_episode(std::size_t env, int episode_count, std::uint32_t attempt) const;
  void begin_next_episode(std::size_t env, HearingEngines* own);
  /// Sets the agent's fault if the episode cannot begin.
  void begin_episode(std::size_t env, std::uint64_t episode_index, int episode_count, HearingEngines* own);
  void prepare_episode(std::size_t env, std::uint64_t episode_index, int episode_count);
  void enter_episode(std::size_t env);
  void enter_agent(std::size_t row, double silent_from_s);
  void leave_episode(std::size_t env);
  void go_idle(std::size_t env);
  void observe_start(std::size_t row, HearingEngines* own);
  [[nodiscard]] NearestGoal goal_of(std::size_t row) const;
  void begin_hearing(std::size_t env);
  void begin_agent_sounds(std::size_t env);
  [[nodiscard]] glm::vec3 source_at(const EnvScene& scene, glm::dvec3 foot) const;
  void restore(std::size_t env, const EnvCursor& cursor, HearingEngines* own);
  void hear_again(std::size_t row, HearingEngines* own, std::size_t step, std::size_t from);
  [[nodiscard]] EnvCursor cursor_of(std::size_t env) const;
  void check_cursor(const EnvCursor& cursor) const;
  /// An agent whose part has ended: its last observation is kept, and it waits.
  void end_part(std::size_t row);
  void end_episode(std::size_t env);
  /// Notes a fault of the running episode; the first one of an agent stays.
  void report(std::size_t row, Fault fault, std::string detail);
  /// Calls the hook with `values`, then reports the fault if one is not finite.
  bool check(std::size_t row, Fault kind, std::span<float> values);
  void clear_rows(std::size_t env);
  void clear_row(std::size_t row);
  /// Of the rows that the batch shows; outcomes in the making are the task's.
  void clear_outcome(std::size_t env);
  void quarantine_episode(std::size_t env, const FaultReport& fault);
  /// began: whether what the agent did can be asked for.
  FinishedEpisode failed_episode(std::size_t row, const FaultReport& fault, bool began = true) const;
  void end_faulty_episode(std::size_t env);
  void quarantine_stalled(std::size_t env);
  void stop_if_none_begins() const;
};

template <class Body>
bool BatchedEnv::Impl::for_agents(std::size_t env, HearingEngines* own, const Body& body) {
  const std::size_t first = first_row(env);
  if (AgentTeam* team = envs[env].team.get()) {
    if (own)  // made here, where it may throw
      for (std::size_t helper = 0; helper < helpers; ++helper) engines_of(workers->num_workers() + env * helpers + helper);
    team->run(per_env, [&](std::size_t agent, std::size_t member) {
      body(first + agent, member == 0 ? own : engines_of(workers->num_workers() + env * helpers + member - 1));
    });
    return true;
  }
  for (std::size_t row = first; row < first + per_env; ++row)
    if (!body(row, own)) return false;
  return true;
}

template <class Body>
void BatchedEnv::Impl::guarded(std::size_t row, Fault kind, const Body& body) {
  try {
    body();
  } catch (const std::bad_alloc&) {
    report(row, kind, "out of memory");
  } catch (const std::exception& error) {
    report(row, kind, error.what());
  } catch (...) {
    report(row, kind, "an exception of a type that is not known");
  }
}

}  // namespace earshot
