// SPDX-License-Identifier: Apache-2.0
#include "trainer/run/start_run.h"

#include <fmt/format.h>

#include <algorithm>
#include <exception>
#include <optional>
#include <set>

#include "sim/base/engine_commit.h"
#include "sim/base/engine_hash.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/config_reader.h"
#include "trainer/checkpoint/checkpoint_bytes.h"
#include "trainer/checkpoint/find_checkpoint.h"
#include "trainer/checkpoint/run_folder.h"
#include "trainer/launch/launcher_job.h"
#include "trainer/net/ring_config.h"
#include "trainer/run/effective_config.h"
#include "trainer/run/episode_data.h"
#include "trainer/run/initial_policy.h"

namespace earshot {
namespace {

constexpr const char* kEngine = "engine";
const std::string kStarts = "starts as run ";

/// Another number of workers begins its environments anew, and would do so in any set of that name.
void check_same_episodes(const RunConfig& config, const RunStart& start) {
  const std::optional<std::uint64_t> before = episode_set_of(read_checkpoint(start.resume));
  const std::uint64_t now = load_episode_set(config.train.file).hash;
  if (!before || *before == now) return;
  throw InputError(config.train.file,
                   fmt::format("has other episodes ({}) than the run in {} had ({})", hex64(now), start.resume.string(), hex64(*before)),
                   "restore the episode set, or allow another one with --change workers,data.train.file and another number of workers");
}

/// Whether `name` is the key or a section that holds it.
bool covers(const std::string& name, const std::string& key) { return key == name || key.starts_with(name + "."); }

void check_declared(const std::vector<std::string>& declared, const std::map<std::string, std::string>& before,
                    const std::map<std::string, std::string>& now) {
  std::set<std::string> known{kEngine};
  for (const auto* config : {&before, &now})
    for (const auto& [key, value] : *config)
      for (std::size_t end = key.find('.');; end = key.find('.', end + 1)) {
        known.insert(key.substr(0, end));
        if (end == std::string::npos) break;
      }
  for (const auto& name : declared) {
    if (known.contains(name)) continue;
    const std::string nearest = nearest_word(name, known);
    throw InputError(
        "--change " + name, "is not a key or section of a run config, and not 'engine'",
        nearest.empty() ? "write the key with its section, for example env.task.forward_m" : "did you mean '" + nearest + "'?");
  }
}

void check_same_run(const RunConfig& config, const RunStart& start) {
  const CheckpointMetadata saved = load_checkpoint_metadata(start.resume);
  if (saved.is_policy)
    throw InputError(start.resume.string(), "is a policy file without training state",
                     "start a new run from it with initial_policy=" + start.resume.string());
  const auto before = flat_config(saved.config_yaml), now = flat_config(config_text(config));
  check_declared(start.changes, before, now);
  const auto declared = [&](const std::string& key) {
    return std::ranges::any_of(start.changes, [&](const std::string& name) { return covers(name, key); });
  };
  std::string keys, problem;
  int num_other_keys = -1;
  for (const auto& change : config_changes(before, now)) {
    if (is_free_to_change(change.key, config) || declared(change.key)) continue;
    if (problem.empty())
      problem = fmt::format("was trained with {} = {}, but the resumed run has {}", change.key, change.before, change.now);
    keys += (keys.empty() ? "" : ",") + change.key;
    ++num_other_keys;
  }
  if (num_other_keys > 0) problem += fmt::format(" ({} more keys differ)", num_other_keys);
  if (!problem.empty())
    throw InputError(start.resume.string(), problem, "restore the old values, or allow the change with --change " + keys);
  if (saved.engine != engine_hash() && !declared(kEngine))
    throw InputError(start.resume.string(),
                     fmt::format("was written by engine {} (commit {}), but this is engine {} (commit {})", saved.engine,
                                 saved.engine_commit, engine_hash(), engine_commit()),
                     "use the program that wrote it, or allow the change with --change engine");
  if (!declared("data.train.file")) check_same_episodes(config, start);
}

}  // namespace

std::filesystem::path newest_checkpoint(const RunConfig& config) {
  return RunFolder(config.out).checkpoints().empty() ? std::filesystem::path() : find_checkpoint(config.out);
}

std::vector<std::string> allowed_changes(const RunStart& start) {
  std::vector<std::string> changes = start.changes;
  if (start.elastic) changes.emplace_back("workers");
  return changes;
}

bool has_reached_end(const RunConfig& config, const CheckpointMetadata& checkpoint) {
  const bool is_out_of_time =
      config.schedule == Schedule::minutes && config.max_minutes > 0 && checkpoint.elapsed_s >= 60 * config.max_minutes;
  return checkpoint.env_steps >= config.total_steps || is_out_of_time;
}

void refuse_mixed_runs(const RunConfig& config, const RunStart& start) {
  if (start.overwrite && start.elastic)
    throw InputError("--overwrite", "would delete the run at each restart of --elastic", "give only one of them");
  if (start.overwrite && !start.resume.empty())
    throw InputError("--overwrite", "would delete the run that --resume continues", "give only one of them");
  if (!start.changes.empty() && start.resume.empty() && !start.elastic)
    throw InputError("--change", "has no effect without --resume", "add --resume, or leave it out");
  const auto checkpoints = RunFolder(config.out).checkpoints();
  if (start.resume.empty() && !checkpoints.empty() && !start.overwrite)
    throw InputError(config.out, fmt::format("contains an earlier run ({} checkpoints)", checkpoints.size()),
                     "continue it with --resume " + config.out + ", replace it with --overwrite, or use another folder with out=FOLDER");
  if (!start.resume.empty() && !checkpoints.empty() && run_folder_of(start.resume) != std::filesystem::weakly_canonical(config.out))
    throw InputError(config.out, "contains a different run than the one to resume, " + start.resume.string(),
                     "use another folder with out=FOLDER");
}

void refuse_stale_episodes(const RunConfig& config, const RunStart& start) {
  check_generator(load_episode_set(config.train.file), expected_generator(config.train, config.env), config.train.file,
                  "write it again with '" + start.remake + "', or remove data.train.scenes from the config to use the file unchanged");
}

void prepare_run(const RunConfig& config, const RunStart& start) {
  refuse_mixed_runs(config, start);
  if (!start.resume.empty()) check_same_run(config, start);
  refuse_stale_episodes(config, start);
  const bool loads_weights = start.resume.empty() && !config.initial_policy.empty();
  if (loads_weights || !config.policy.module.empty()) check_policy(config, start.resume);
  if (start.overwrite) RunFolder(config.out).remove_run();
}

PreparedRun prepare_run(const RunConfig& config, const RunStart& asked, Collective& collective) {
  const int rank = collective.identity().rank;
  RunStart start = asked;
  std::shared_ptr<RunLock> lock = start.lock;
  std::exception_ptr refusal;
  std::string message;
  if (rank == 0) try {
      if (!lock) lock = RunLock::acquire(config.out, "earshot train", run_lock_options(launcher_job()));
      if (start.elastic) start.resume = newest_checkpoint(config);
      prepare_run(config, start);
      message = kStarts + lock->run() + "\n" + start.resume.string();
    } catch (const std::exception& error) {
      refusal = std::current_exception();
      message = error.what();
    }
  const std::string decision = collective.all_gather(message).front();
  if (refusal) std::rethrow_exception(refusal);
  if (!decision.starts_with(kStarts)) throw InputError(worker_name(rank), "rank 0 refuses to start: " + decision, "");
  const std::size_t end = decision.find('\n');
  if (start.elastic) start.resume = decision.substr(end + 1);
  return {RunClaim(config.out, std::move(lock), decision.substr(kStarts.size(), end - kStarts.size()), asked.lock != nullptr),
          start.resume};
}

}  // namespace earshot
