// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <memory>

#include "apps/commands.h"
#include "sim/base/errors.h"
#include "trainer/checkpoint/run_lock.h"
#include "trainer/launch/launcher_job.h"
#include "trainer/run/planned_acoustics.h"

namespace earshot {
namespace {

struct PlanArguments {
  std::string config;
  std::vector<std::string> overrides;
};

void run_plan(const PlanArguments& options) {
  const RunConfig config = load_run_config(options.config, options.overrides);
  if (config.env.accuracy.empty())
    throw InputError(options.config, "has no env.accuracy", "add it, for example env.accuracy=\"t20=10%,drr=2dB\"");
  if (with_kept_acoustics(config, {config.out})) {
    fmt::print("env.accuracy {}: already planned in {}\n", config.env.accuracy, acoustics_plan_file(config, config.out).string());
    return;
  }
  const auto lock = RunLock::acquire(config.out, "earshot plan", run_lock_options(launcher_job()));
  static_cast<void>(plan_acoustics(config));
}

}  // namespace

void add_plan(CLI::App& app) {
  const auto options = std::make_shared<PlanArguments>();
  CLI::App* command = app.add_subcommand("plan", "Choose acoustic settings that meet env.accuracy of a run, and store them in its folder");
  command->add_option("CONFIG", options->config, "Run config (YAML)")->required();
  command->add_option("OVERRIDES", options->overrides, "Override keys of the config: key=value");
  command->footer(
      "'earshot train' and 'earshot eval' plan automatically when no plan exists.  Workers under a launcher do not: run this command once\n"
      "before, so that all workers use the same settings.  The plan is written to `out`/acoustics_HASH.yaml.");
  command->callback([options] { run_plan(*options); });
}

}  // namespace earshot
