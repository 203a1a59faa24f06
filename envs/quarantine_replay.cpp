#include "envs/quarantine_replay.h"

#include <utility>

#include "envs/batched_env.h"
#include "envs/engine_commit.h"

namespace earshot {
namespace {

EnvConfig config_of(const QuarantineRecord& record, const std::vector<std::string>& overrides) {
  EnvConfig config;
  ConfigReader reader = ConfigReader::from_text(record.config, "config of the quarantined episode", overrides);
  read(reader, config);
  reader.finish();
  // What changes no bit, and what must not happen here.
  config.threads = 1;
  config.prefetch = false;
  config.quarantine_dir.clear();
  config.order = EpisodeOrder::once;  // idle after the episode, however it ends
  config.autoreset = Autoreset::same_step;
  config.seed = record.seed;
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
  while (!outcome.fault && outcome.step < record.step && env.active()[0]) {
    env.step(std::vector<std::int32_t>{record.actions[static_cast<std::size_t>(outcome.step)]});
    ++outcome.step;
    for (const FinishedEpisode& finished : env.finished()) outcome.fault = finished.fault;
  }
  outcome.recurs = outcome.fault && outcome.fault->fault == record.report.fault && outcome.step == record.step;
  return outcome;
}

}  // namespace earshot
