#include <fmt/format.h>

#include <memory>

#include "apps/commands.h"
#include "sim/base/errors.h"
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
    throw InputError(options.config, "asks for no env.accuracy", "add it, for example env.accuracy=\"t20=10%,drr=2dB\"");
  if (with_kept_acoustics(config, {config.out})) {
    fmt::print("env.accuracy {}: already kept in {}\n", config.env.accuracy, acoustics_plan_file(config, config.out).string());
    return;
  }
  static_cast<void>(plan_acoustics(config));
}

}  // namespace

void add_plan(CLI::App& app) {
  const auto options = std::make_shared<PlanArguments>();
  CLI::App* command = app.add_subcommand("plan", "Choose the acoustics that a run's env.accuracy asks for, and keep them in its folder");
  command->add_option("CONFIG", options->config, "Run config (YAML)")->required();
  command->add_option("OVERRIDES", options->overrides, "key=value over the config");
  command->footer(
      "`earshot train` and `earshot eval` do this by themselves where it has not been done; workers of a launcher on their own machines\n"
      "do not, so that all of them hear the same.  The file is `out`/acoustics_HASH.yaml.");
  command->callback([options] { run_plan(*options); });
}

}  // namespace earshot
