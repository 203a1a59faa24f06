// SPDX-License-Identifier: Apache-2.0
#include "envs/batch/quarantine_replay.h"

#include <algorithm>
#include <utility>

#include "envs/batch/batched_env.h"
#include "sim/base/engine_commit.h"
#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

EnvConfig config_of(const QuarantineRecord& record, const std::vector<std::string>& overrides) {
  EnvConfig config;
  ConfigReader reader = ConfigReader::from_text(record.config, "config of the quarantined episode", overrides);
  read(reader, config);
  reader.finish();
  // Settings that change no bit, and settings that are invalid here.
  config.threads = 1;
  config.prefetch = false;
  config.quarantine_dir.clear();
  config.order = EpisodeOrder::once;  // idle after the episode, however it ends
  config.autoreset = Autoreset::same_step;
  config.seed = record.seed;
  if (record.others.size() + 1 != static_cast<std::size_t>(config.agents))
    throw InputError("config of the quarantined episode", "has a different number of agents than its recorded actions",
                     "use an unchanged file from the quarantine_dir of a run");
  return config;
}

}  // namespace

ReplayOutcome replay(const QuarantineRecord& record, const std::vector<std::string>& overrides, const StageHook& hook) {
  const EnvConfig config = config_of(record, overrides);
  EpisodeSet set;
  set.episodes = {record.episode};
  set.hash = episode_set_hash(set.episodes);
  BatchedEnv env(config, std::make_shared<const EpisodeSet>(std::move(set)), make_scene_cache(config), 1, record.env, record.env + 1);
  env.set_stage_hook(hook);

  ReplayOutcome outcome{.fault = {}, .step = 0, .recurs = false, .same_engine = record.engine == engine_commit()};
  outcome.fault = env.begin(0, 0, record.episode_count);
  const auto goes_on = [&] { return std::ranges::any_of(env.active(), [](std::uint8_t active) { return active != 0; }); };
  std::vector<std::int32_t> actions(static_cast<std::size_t>(config.agents));
  while (!outcome.fault && outcome.step < record.step && goes_on()) {
    const auto step = static_cast<std::size_t>(outcome.step);
    for (std::size_t agent = 0; agent < actions.size(); ++agent) {
      const auto& taken = agent == 0 ? record.actions : record.others[agent - 1];
      actions[agent] = step < taken.size() ? taken[step] : 0;  // one that waits takes none
    }
    env.step(actions);
    ++outcome.step;
    for (const FinishedEpisode& finished : env.finished()) outcome.fault = finished.fault;
  }
  outcome.recurs = outcome.fault && outcome.fault->fault == record.report.fault && outcome.step == record.step;
  return outcome;
}

}  // namespace earshot
