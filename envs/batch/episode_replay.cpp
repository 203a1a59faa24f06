// SPDX-License-Identifier: Apache-2.0
#include "envs/batch/episode_replay.h"

#include <algorithm>

#include "sim/base/errors.h"

namespace earshot {
namespace {

[[noreturn]] void refuse_damaged(const char* problem) { throw InputError("environment state", problem, "use another checkpoint"); }

}  // namespace

const std::vector<std::int8_t>& EpisodeReplay::actions_of(const Agent& agent) const {
  return agent.number == 0 ? cursor_->actions : cursor_->others[size_of(agent.number - 1)];
}

std::size_t EpisodeReplay::heard_from(const Agent& agent) const {
  const std::size_t block = size_of(setup_->block_samples);
  const std::size_t window_blocks = (size_of(setup_->window_samples()) + block - 1) / block + 2;
  const std::size_t count = actions_of(agent).size();
  return count > window_blocks ? count - window_blocks : 0;
}

void EpisodeReplay::walk() {
  const Agent& lead = run_->agents.front();
  if (cursor_->scene != 0 && cursor_->scene != lead.source->scene->scene->hash())
    throw InputError(setup_->set->episodes[cursor_->episode_index].scene_id, "has changed since the environment state was saved",
                     "restore the files of the scene, or begin a new run");
  std::size_t steps = 0;
  for (const Agent& agent : run_->agents) steps = std::max(steps, actions_of(agent).size());
  for (std::size_t step = 0; step <= steps; ++step) {
    run_->steps = static_cast<int>(step);
    const bool any_hears = move(step);
    if (any_hears) run_->sounds.move(*setup_, run_->steps, run_->agents, engines_, run_->team.get());
    for (Agent& agent : run_->agents) {
      const std::size_t count = actions_of(agent).size();
      if (step > count) continue;
      if (step >= heard_from(agent)) hear(agent, step);
      if (step == count && step < steps) {
        senses_->render(*run_, agent);
        senses_->observe(*run_, agent, engines_);
        senses_->end_part(agent);
      }
    }
  }
  if (std::ranges::all_of(run_->agents, &Agent::has_ended) != cursor_->ended)
    refuse_damaged("its last action does not match the end of the episode");
  observe();
}

bool EpisodeReplay::move(std::size_t step) {
  bool any_hears = false;
  for (Agent& agent : run_->agents) {
    const std::vector<std::int8_t>& actions = actions_of(agent);
    if (step > actions.size()) {
      if (!agent.has_ended()) refuse_damaged("has an agent that took fewer actions than the others without having ended");
      continue;
    }
    any_hears = any_hears || step >= heard_from(agent);
    if (step == 0) continue;
    if (agent.has_ended()) refuse_damaged("it has actions after the end of the episode");
    agent.outcome = {};
    agent.actions.push_back(actions[step - 1]);
    senses_->move(*run_, agent, static_cast<Action>(actions[step - 1]));
  }
  return any_hears;
}

void EpisodeReplay::hear(Agent& agent, std::size_t step) {
  const std::size_t from = heard_from(agent);
  const std::size_t window = size_of(setup_->window_samples()), block = size_of(setup_->block_samples);
  if (step > 0 && step == from) agent.hearing.seek(window + (step - 1) * block);
  senses_->trace(agent, engines_, step == 0 ? setup_->window_samples() : setup_->block_samples);
  senses_->synthesize(agent, engines_);
  if (step == 0) {
    if (engines_ && agent.runs()) senses_->fill_window(agent, *engines_);
  } else if (step == from) {
    agent.hearing.seek(window + step * block);
  } else {
    senses_->convolve(agent, engines_);
  }
}

void EpisodeReplay::observe() {
  for (Agent& agent : run_->agents) {
    agent.outcome.reward = 0;
    if (agent.waits) continue;
    senses_->render(*run_, agent);
    senses_->observe(*run_, agent, engines_);
    if (!cursor_->ended && agent.has_ended()) senses_->end_part(agent);
  }
}

}  // namespace earshot
