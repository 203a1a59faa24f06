// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <vector>

#include "envs/config/env_config.h"
#include "envs/hearing/source_hearing.h"

namespace earshot {

/// The HearingEngines of the threads of a batch.  Tables and spectra are shared; plans and scratch of a thread are made when it asks for
/// the first time.  Threads of different numbers may ask at the same time.
class EnginePool {
 public:
  /// Makes the synthesis tables, 0.5 s of a core, where a sensor hears.  block_samples: of sound in a step.  Throws InputError for
  /// config.hrtf.
  EnginePool(const EnvConfig& config, int block_samples);

  /// How many threads of each sort there may be.  Before any asks.
  void resize(std::size_t workers, std::size_t helpers);
  /// The engines of a thread that runs tasks, and of one that helps another with the agents of its env.  Null: no sensor hears.
  HearingEngines* of_worker(std::size_t worker) { return made(workers_[worker]); }
  HearingEngines* of_helper(std::size_t helper) { return made(helpers_[helper]); }

 private:
  HearingEngines* made(std::unique_ptr<HearingEngines>& engines) const {
    if (!engines && make_) engines = make_();
    return engines.get();
  }

  std::function<std::unique_ptr<HearingEngines>()> make_;  ///< empty: no sensor hears
  std::vector<std::unique_ptr<HearingEngines>> workers_, helpers_;
};

}  // namespace earshot
