// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "bench/measure/statistics.h"
#include "bench/soak/episodes.h"

namespace earshot {

/// Observation and result of one agent in one step.
struct SoakRows {
  std::span<float> depth, spectrogram, audiogoal, pointgoal;  ///< audiogoal: empty at the end of an episode (the next one's is there)
  float reward = 0;
};

/// Copies the rows of one env; they stay until the next call.
class SoakRowCopy {
 public:
  /// ended: the last observation of the episode that ended in this step.
  SoakRows take(const BatchedEnv& env, std::size_t row, bool ended);

 private:
  std::vector<float> depth_, spectrogram_, audiogoal_, pointgoal_;
};

/// Faults of a step.
enum class SoakFault { not_finite, out_of_range, too_loud, out_of_the_scene };
inline constexpr std::size_t kNumSoakFaults = 4;

/// An episode that ended: enough to run it again from nothing.
struct SoakRecord {
  int env = 0;                      ///< global id
  std::uint64_t episode_index = 0;  ///< in the set
  int episode_count = 0;            ///< episodes that this env had begun before
  std::vector<std::int8_t> actions;
  std::uint64_t hash = 0;  ///< of all that was observed, see EpisodeHash
};

/// Running hash of an episode's observations: depth, spectrogram and sound of every step, and the rewards.
class EpisodeHash {
 public:
  void begin() { hash_ = 0; }
  void add(const SoakRows& rows);
  [[nodiscard]] std::uint64_t value() const { return hash_; }

 private:
  std::uint64_t hash_ = 0;
};

/// Upper limit of the sound level, as a multiple of (energy of the free field at the shortest distance of the step plus diffuse field of
/// the
/// source's room) times the largest mean square of the dry sound.  6 dB: a rigid sphere doubles the pressure at most (Duda and Martens
/// 1998); 12 dB: in a reverberant field the energy of a steady tone is distributed exponentially over places (Schroeder 1954), and exceeds
/// 16 times its mean once in 10^7 draws; four equal images in phase (source in the corner of two walls) make the same 12 dB of the free
/// field.
inline constexpr double kLoudnessMargin = 4 * 16;

/// Checks every output of a batch of environments, and counts violations.
class SoakWatch {
 public:
  struct Example {
    SoakFault fault;
    std::string what;  ///< which value, where
  };
  struct KindTotals {
    std::uint64_t steps = 0, episodes = 0;
    double loudest = 0;  ///< heard energy over the expected, without margin
  };
  /// Between the environments and the watch, for tests of the watch: may change a copy of the rows.
  using Tamper = std::function<void(std::uint64_t steps, int env, SoakRows& rows)>;

  SoakWatch(const std::vector<SoakScene>& scenes, const SoakEpisodes& episodes, const EnvConfig& config, int num_envs, int keep_records,
            Tamper tamper = {});

  /// After BatchedEnv::reset().
  void check_start(const BatchedEnv& env);
  /// After BatchedEnv::step(actions).  Steps of idle envs do not count.
  void check(const BatchedEnv& env);

  [[nodiscard]] std::uint64_t steps() const { return steps_; }
  [[nodiscard]] std::uint64_t episodes() const { return num_finished_; }
  [[nodiscard]] std::uint64_t count(SoakFault fault) const { return faults_[static_cast<std::size_t>(fault)]; }
  [[nodiscard]] const std::vector<Example>& examples() const { return examples_; }  ///< the first few
  [[nodiscard]] const std::array<KindTotals, kNumSoakKinds>& kinds() const { return kinds_; }
  /// Heard energy over the expected, without margin, per ear and step.
  [[nodiscard]] const LogHistogram& loudness() const { return loudness_; }
  [[nodiscard]] double largest_reward() const { return largest_reward_; }
  /// A uniform sample of the episodes that ended (reservoir sampling; Vitter 1985, algorithm R).
  [[nodiscard]] const std::vector<SoakRecord>& records() const { return records_; }
  [[nodiscard]] std::uint64_t successes() const { return successes_; }

 private:
  struct Agent {
    std::uint64_t episode_index = 0;
    int episode_count = 0;
    bool active = false;
    double distance_m = 0;      ///< to the source
    double diffuse_energy = 0;  ///< of its room
    EpisodeHash hash;
  };
  void begin(const BatchedEnv& env, std::size_t row);
  /// nearest_m: shortest distance to the source during the step.
  void check(const BatchedEnv& env, std::size_t row, bool ended, double nearest_m);
  void check_place(const BatchedEnv& env, std::size_t row);
  void check_loudness(const BatchedEnv& env, std::size_t row, std::span<const float> sound, double nearest_m);
  void report(SoakFault fault, const std::string& what);
  [[nodiscard]] std::string place_of(const BatchedEnv& env, std::size_t row, bool ended) const;
  void keep(const FinishedEpisode& finished, const Agent& agent);

  const std::vector<SoakScene>& scenes_;
  const SoakEpisodes& episodes_;
  EnvConfig config_;
  std::size_t keep_records_;
  Tamper tamper_;
  std::vector<Agent> agents_;
  SoakRowCopy copy_;
  std::uint64_t steps_ = 0, num_finished_ = 0, successes_ = 0;
  std::array<std::uint64_t, kNumSoakFaults> faults_{};
  std::vector<Example> examples_;
  std::array<KindTotals, kNumSoakKinds> kinds_{};
  LogHistogram loudness_;
  double largest_reward_ = 0;
  std::vector<SoakRecord> records_;
};

}  // namespace earshot
