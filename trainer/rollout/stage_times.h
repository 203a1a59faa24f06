// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <string>

#include "envs/batch/batched_env.h"

namespace earshot {

/// Wall seconds per stage of training, for the progress line: where the time goes.
struct StageTimes {
  double simulate_sound = 0;  ///< path tracing and RIR synthesis
  double convolve = 0;        ///< sound stream and spectrogram
  double render = 0;          ///< cameras
  double move = 0;            ///< motion, rewards, episode starts
  double policy = 0;          ///< inference
  double learn = 0, reduce = 0;

  static StageTimes of(const StageSeconds& env);
  void add(const StageTimes& other, double factor = 1.0);
  [[nodiscard]] double total() const;
  /// "sound 31 %  convolve 8 %  ..."
  [[nodiscard]] std::string fractions() const;
};

/// Seconds from one call to the next.
class LapTimer {
 public:
  /// Seconds since construction or the last call.
  double lap() {
    const auto now = Clock::now();
    const double seconds = std::chrono::duration<double>(now - last_).count();
    last_ = now;
    return seconds;
  }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point last_ = Clock::now();
};

}  // namespace earshot
