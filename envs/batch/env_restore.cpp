#include <algorithm>

#include "envs/batch/batched_env_impl.h"
#include "sim/base/errors.h"

namespace earshot {

void BatchedEnv::Impl::restore(std::size_t env, const EnvCursor& cursor, HearingEngines* own) {
  EnvRun& run = envs[env];
  const std::size_t first = first_row(env), end = first + per_env;
  seed_env(env, cursor.seed, cursor.stream);
  for (Agent& agent : agents_of(env)) agent.episode_count = cursor.episode_count;
  run.failed_starts.clear();
  if (!cursor.active) return go_idle(env);
  if (cursor.is_void) {
    if (config.autoreset == Autoreset::same_step) return begin_next_episode(env, own);
    prepare_episode(env, cursor.episode_index, cursor.episode_count);
    clear_rows(env);
    run.has_ended = run.is_void = true;
    return;
  }
  const auto damaged = [](const char* what) { throw InputError("environment state", what, "resume from another checkpoint"); };
  const auto stop_at_fault = [&] {
    if (const FaultReport* fault = fault_of(env))
      throw InputError("episode '" + episode_of(agents[first]).episode_id + "' in " + episode_of(agents[first]).scene_id, fault->detail,
                       "it ran when the state was saved: bring back what is missing, or resume from another checkpoint");
  };
  prepare_episode(env, cursor.episode_index, cursor.episode_count);
  enter_episode(env);
  stop_at_fault();
  ++begun;
  const auto actions_of = [&](std::size_t row) -> const std::vector<std::int8_t>& {
    return row == first ? cursor.actions : cursor.others[row - first - 1];
  };
  std::size_t steps = 0;
  for (std::size_t row = first; row < end; ++row) steps = std::max(steps, actions_of(row).size());
  // What is heard now depends on the poses of the last second only, and on the two steps before, by which paths arrive and which of them
  // glide (PathGlider::choose): poses before are walked, not rendered.
  const std::size_t window_blocks =
      (size_of(config.observation.sound.num_samples) + size_of(block_samples) - 1) / size_of(block_samples) + 2;
  const auto heard_from = [&](std::size_t row) {
    const std::size_t count = actions_of(row).size();
    return count > window_blocks ? count - window_blocks : 0;
  };
  for (std::size_t step = 0; step <= steps; ++step) {
    run.steps = static_cast<int>(step);
    bool any_hears = false;
    for (std::size_t row = first; row < end; ++row) {
      if (step > actions_of(row).size()) {
        if (!ended(row)) damaged("has an agent that took fewer actions than the others and has not ended");
        continue;
      }
      any_hears = any_hears || step >= heard_from(row);
      if (step == 0) continue;
      if (ended(row)) damaged("its actions go on after the end of the episode");
      agents[row].outcome = {};
      agents[row].actions.push_back(actions_of(row)[step - 1]);
      move(row, static_cast<Action>(actions_of(row)[step - 1]));
    }
    if (any_hears) move_sounds(env, own);
    for (std::size_t row = first; row < end; ++row) {
      if (step > actions_of(row).size()) continue;
      if (step >= heard_from(row)) hear_again(row, own, step, heard_from(row));
      if (step == actions_of(row).size() && step < steps) {
        render(row);
        observe(row, own);
        end_part(row);
      }
    }
  }
  bool all_ended = true;
  for (std::size_t row = first; row < end; ++row) all_ended = all_ended && ended(row);
  if (all_ended != cursor.ended) damaged("its last action ends the episode, or should");
  for (std::size_t row = first; row < end; ++row) {
    agents[row].outcome.reward = 0;
    if (agents[row].waits) continue;
    render(row);
    observe(row, own);
    if (!cursor.ended && ended(row)) end_part(row);
  }
  stop_at_fault();
  if (!cursor.ended) return;
  run.has_ended = true;
  for (std::size_t row = first; row < end; ++row) {
    if (!agents[row].waits) keep_rows(row);
    agents[row].waits = false;
  }
}

/// The sound of one step of a restored episode, of which the first to be heard is `from`.
void BatchedEnv::Impl::hear_again(std::size_t row, HearingEngines* own, std::size_t step, std::size_t from) {
  AgentHearing& hearing = agents[row].hearing;
  const std::size_t window = size_of(config.observation.sound.num_samples);
  if (step > 0 && step == from) hearing.seek(window + (step - 1) * size_of(block_samples));
  trace(row, own, step == 0 ? config.observation.sound.num_samples : block_samples);
  synthesize(row, own);
  if (step == 0) {
    if (own && runs(row))
      hearing.fill_window(*own, block_samples, rows.of(SensorKind::waveform)->row<float>(row), rows.of(SensorKind::heard)->row<float>(row));
  } else if (step == from) {
    hearing.seek(window + step * size_of(block_samples));
  } else {
    convolve(row, own);
  }
}

EnvCursor BatchedEnv::Impl::cursor_of(std::size_t env) const {
  const EnvRun& run = envs[env];
  const std::span<const Agent> ours = agents_of(env);
  const Agent& lead = ours.front();
  const bool is_void = run.stalled || (run.has_ended && run.is_void);
  EnvCursor cursor{.active = run.stalled || run.has_episode,
                   .ended = run.has_ended,
                   .is_void = is_void,
                   .seed = lead.seed,
                   .stream = lead.stream,
                   .episode_index = lead.episode_index,
                   .episode_count = std::max(0, lead.episode_count),
                   .actions = is_void ? std::vector<std::int8_t>{} : lead.actions};
  for (const Agent& agent : ours.subspan(1)) cursor.others.push_back(is_void ? std::vector<std::int8_t>{} : agent.actions);
  return cursor;
}

}  // namespace earshot
