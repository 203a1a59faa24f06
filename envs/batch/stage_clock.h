// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <chrono>
#include <cstddef>

#include "envs/batch/batched_env.h"

namespace earshot {

/// The stages whose time is counted.
enum class Stage : std::size_t { move, trace, synthesize, convolve, render, observe, reset };

/// The field of each stage, in the order of Stage.
inline constexpr std::array kStageSeconds{&StageSeconds::move,   &StageSeconds::trace,   &StageSeconds::synthesize, &StageSeconds::convolve,
                                          &StageSeconds::render, &StageSeconds::observe, &StageSeconds::reset};

/// Books the time since the last call to a stage.  One thread at a time.
class StageClock {
 public:
  /// seconds: where time is added; must outlive the clock.  weight: each second counts so often; 0: the clock is never read.
  StageClock(StageSeconds& seconds, double weight) : seconds_(&seconds), weight_(weight) {
    if (weight_ > 0) last_ = std::chrono::steady_clock::now();
  }
  void book(Stage stage) {
    if (weight_ <= 0) return;
    const auto now = std::chrono::steady_clock::now();
    seconds_->*kStageSeconds[static_cast<std::size_t>(stage)] += weight_ * std::chrono::duration<double>(now - last_).count();
    last_ = now;
  }

 private:
  StageSeconds* seconds_;
  double weight_;
  std::chrono::steady_clock::time_point last_;
};

}  // namespace earshot
