// SPDX-License-Identifier: Apache-2.0
#pragma once

/// @file
/// Batches of audio-visual navigation environments.

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "earshot/config.h"
#include "earshot/episodes.h"
#include "earshot/navigation.h"
#include "earshot/vec3.h"

namespace earshot::api {

/// Actions of an agent by number, as step() takes them.
enum class Action : std::int32_t { stop = 0, forward = 1, left = 2, right = 3 };
inline constexpr int kNumActions = 4;

enum class SensorType : std::uint8_t { float32, uint8, uint16, int32 };

/// One sensor: a key of the observations.
struct SensorInfo {
  std::string name;
  SensorType type = SensorType::float32;
  std::vector<int> shape;                   ///< of one row
  std::string units;                        ///< "m", "rad", "1"; of mixed units one for each number
  double low = 0, high = 0;                 ///< closed range of the values; infinite where there is no bound
  bool privileged = false;                  ///< derived from the goal or the map: no agent could sense it
  [[nodiscard]] std::size_t count() const;  ///< numbers in a row
};

/// A finished episode of one agent.
struct EpisodeResult {
  int env = 0, agent = 0;
  std::uint64_t episode_index = 0;  ///< in the set
  double success = 0, spl = 0, soft_spl = 0, sna = 0;
  double distance_to_goal_m = 0, success_when_silent = 0, episode_return = 0;
  int steps = 0, collisions = 0;
  bool stopped = false;  ///< ended by `stop`; else out of steps
};

/// Place of an agent.
struct AgentPose {
  Vec3 position;           ///< foot point, in the coordinates of the scene's file
  double heading_rad = 0;  ///< counter-clockwise from -z
};

/// Options of a batch.
struct VectorEnvOptions {
  std::string split = "train";  ///< of a run config: section of `data` that names the episodes
  int first_env = 0;            ///< number of the first env, where several batches share a run
  Settings settings = {};       ///< keys of the env section over the config: {{"threads", 0}, {"autoreset", "next_step"}}
};

/// Steps many audio-visual navigation environments in parallel.
///
/// A batch holds num_envs() environments with num_agents() agents each.  Call reset() once, then step() with one action per row; row = env
/// * num_agents() + agent.  Rows, rewards and flags are memory of the batch: they stay valid until the next call that changes their
/// environment.  When an episode ends, its last observation is in the final rows and the next episode starts (key `autoreset`).
///
/// \code
/// earshot::VectorEnv envs(earshot::Config::from_file("configs/train/quick.yaml"), 32, {.settings = {{"threads", 0}}});
/// envs.reset();
/// while (training) envs.step(act(envs.rows_as<float>("depth")));
/// \endcode
///
/// Bits:    depend on the episodes, the config, the number of the env and the actions; not on threads or on how a batch is split.
/// Faults:  a value that is not finite or an exception ends the episode for all of its agents: reward 0, truncated, quarantined.
/// Threads: one caller at a time; the work runs on `threads` threads.
/// Errors:  InputError for a config or set that cannot work; std::logic_error, std::invalid_argument or std::out_of_range for a wrong call,
///          which changes nothing.
class VectorEnv {
 public:
  /// @param config    a run config of `earshot train` (its sections env and data.SPLIT are used), or the keys of an env section and the
  ///                  episodes under `episodes`.
  /// @param num_envs  [1, 65536].
  /// @param options   split, first env and settings.
  VectorEnv(const Config& config, int num_envs, const VectorEnvOptions& options = {});
  /// The same with these episodes, whatever the config says of episodes.
  VectorEnv(const Config& config, const EpisodeSet& episodes, int num_envs, const VectorEnvOptions& options = {});
  ~VectorEnv();
  VectorEnv(VectorEnv&&) noexcept;
  VectorEnv& operator=(VectorEnv&&) noexcept;

  /// Starts the first episode of every env.
  void reset();
  /// Starts episode number `index` of the set in one env; the other envs go on.  It has the bits of its turn with `order: once` in a batch
  /// of one env, in any env.  The next episode of the env is then the next of its own sequence, as if this one had not been.
  /// @throws InputError if it cannot begin, std::out_of_range or std::invalid_argument for an env or an episode that does not exist.
  void begin_episode(int env, std::uint64_t index);
  /// Puts the agent of an env with one agent elsewhere and fills its observation, with the sound of an agent who has stood there before.
  /// The env cannot be saved until its next episode.
  /// @param pose   the nearest place on the floor is taken.
  /// @param steps  the time, as that of the end of this step of the episode: [0, task.max_steps).
  /// @throws InputError for a place off the floor or without a way to the goal; std::logic_error without a running episode.
  void place(int env, const AgentPose& pose, int steps);
  /// Starts episodes in the envs whose flag is not 0.
  /// @param mask   [num_envs].
  /// @param seeds  [num_envs] or empty: an env with a seed begins the first episode of that seed's sequence.
  void reset(std::span<const std::uint8_t> mask, std::span<const std::uint64_t> seeds = {});
  /// @param actions  [num_rows], values 0 to 3.  Actions of agents that wait are ignored.
  void step(std::span<const std::int32_t> actions);
  /// Begins a step of some envs in the background; their rows must not be read until recv() hands them back.
  /// @param envs     [n], each at most once.
  /// @param actions  [n * num_agents].
  void send(std::span<const std::int32_t> envs, std::span<const std::int32_t> actions);
  /// Waits until recv() with these arguments would not wait.  Hands nothing back: a caller that gives up the wait loses nothing.
  void wait_ready(int min_ready, bool as_sent = false);
  /// Waits until at least `min_ready` envs are done and hands them back, by ascending number.
  /// @param min_ready  [1, envs under way].
  /// @param as_sent    the first that were sent, the same in every run; else all that are done.
  std::vector<std::int32_t> recv(int min_ready, bool as_sent = false);

  /// Whether steps begun by send() or loads of coming episodes go on.  From any thread, at any time, without a lock.
  [[nodiscard]] bool works_in_background() const;

  [[nodiscard]] int num_envs() const;
  [[nodiscard]] int num_agents() const;           ///< of each env
  [[nodiscard]] int num_rows() const;             ///< num_envs() * num_agents()
  [[nodiscard]] std::string autoreset() const;    ///< "same_step", "next_step" or "off"
  [[nodiscard]] std::string config_text() const;  ///< every key of the env section with its value, as YAML

  [[nodiscard]] const std::vector<SensorInfo>& sensors() const;
  /// Bytes of a sensor, [rows, shape]; empty where it is off.
  [[nodiscard]] std::span<const std::byte> rows(std::string_view sensor) const;
  /// The same of the observations in which the episodes that ended last ended.
  [[nodiscard]] std::span<const std::byte> final_rows(std::string_view sensor) const;
  /// Numbers of a sensor: T is float, std::uint8_t, std::uint16_t or std::int32_t.
  /// @throws std::invalid_argument if the sensor has another type or there is no such sensor.
  template <class T>
  [[nodiscard]] std::span<const T> rows_as(std::string_view sensor) const;

  [[nodiscard]] std::span<const float> rewards() const;            ///< [rows], of the last step
  [[nodiscard]] std::span<const std::uint8_t> terminated() const;  ///< [rows], 1: stop was called
  [[nodiscard]] std::span<const std::uint8_t> truncated() const;   ///< [rows], 1: out of steps
  [[nodiscard]] std::span<const std::uint8_t> active() const;      ///< [rows], 0: idle, or waits for the other agents
  [[nodiscard]] std::span<const std::uint8_t> collided() const;
  [[nodiscard]] std::span<const std::uint8_t> quarantined() const;  ///< [rows], 1: taken out of the run in the last step; no experience
  [[nodiscard]] std::span<const std::uint8_t> acted() const;        ///< [rows], 0: the step began an episode, or the agent waits
  /// Episodes that ended in the last step, or of the envs that recv() handed back, by env.
  [[nodiscard]] std::vector<EpisodeResult> finished() const;

  /// Files of the scenes, sounds and head filters, with hashes: two batches of equal files, config and actions have equal bits.  Reads each
  /// file once.
  /// @throws InputError for a file that cannot be read, or has changed since the batch was made.
  [[nodiscard]] std::vector<InputFile> input_files() const;

  [[nodiscard]] AgentPose pose(int row) const;
  /// The floor of the scene that the row is in; stays valid after the batch.
  [[nodiscard]] Navigation navigation(int row) const;
  [[nodiscard]] std::string scene_name(int row) const;
  [[nodiscard]] std::uint64_t episode_index(int row) const;

  /// State of all running episodes; restore_state() gives the same bits in all observations from there on.
  [[nodiscard]] std::string save_state() const;
  /// @throws InputError if the state is damaged, or of another set, seed or batch; so does restore().
  void restore_state(std::string_view state);
  /// The same for one env; a snapshot can be restored in any env of any batch with the same set and config.
  [[nodiscard]] std::string snapshot(int env) const;
  void restore(int env, std::string_view snapshot);

  struct Model;
  [[nodiscard]] Model& model() const { return *model_; }  ///< for the library

 private:
  [[nodiscard]] std::span<const std::byte> typed_rows(std::string_view sensor, SensorType type) const;
  std::unique_ptr<Model> model_;
};

template <class T>
inline constexpr SensorType kSensorTypeOf = SensorType::float32;
template <>
inline constexpr SensorType kSensorTypeOf<std::uint8_t> = SensorType::uint8;
template <>
inline constexpr SensorType kSensorTypeOf<std::uint16_t> = SensorType::uint16;
template <>
inline constexpr SensorType kSensorTypeOf<std::int32_t> = SensorType::int32;

template <class T>
std::span<const T> VectorEnv::rows_as(std::string_view sensor) const {
  const std::span<const std::byte> bytes = typed_rows(sensor, kSensorTypeOf<T>);
  return {reinterpret_cast<const T*>(bytes.data()), bytes.size() / sizeof(T)};
}

}  // namespace earshot::api
