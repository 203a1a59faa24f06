// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "trainer/held_out/held_out_evaluator.h"
#include "trainer/run/run_config.h"

namespace earshot {

/// The evaluator of a run: that of `earshot eval` on data.held_out, with the acoustics, batch (eval_envs) and seed of sampled actions (0)
/// that it has, so that it gives the same numbers.  All workers pause and split the episodes by rounds of the batch: the cost is that of
/// both ways of acting on all episodes, divided by the workers as far as there are rounds.  Scenes stay loaded between evaluations, within
/// env.scene_cache_gb beside those of the training.
/// config: with decided acoustics.  Null where config.held_out is off.  Throws InputError as load_evaluated_set.
std::unique_ptr<HeldOutEvaluator> make_held_out_evaluator(const RunConfig& config);

}  // namespace earshot
