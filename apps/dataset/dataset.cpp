// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <memory>

#include "apps/commands.h"
#include "apps/options/output_options.h"
#include "apps/options/scene_options.h"
#include "sim/base/output_paths.h"
#include "trainer/run/episode_data.h"

namespace earshot {
namespace {

struct DatasetArguments {
  std::vector<std::string> scenes, overrides;
  AxesOptions axes;
  std::string config, out, sounds;
  int count = 50, goals = 0, agents = 1;
  std::string agent_sounds;
  std::uint64_t seed = 0;
};

void generate(const DataConfig& data, const EnvConfig& env) {
  const EpisodeSet set = generate_data(data, env);
  fmt::print("{}: {} episodes\n", data.file, set.episodes.size());
}

void run_dataset(const DatasetArguments& options) {
  if (!options.config.empty()) {
    if (!options.scenes.empty()) throw InputError("--config", "already names the scenes", "give either SCENE or --config");
    if (options.axes.is_given())
      throw InputError("--config", "names the scenes itself, but --unit, --up or --cell was given",
                       "write FILE,unit=METRES, FILE,up=z or FILE,cell=METRES in data.train.scenes and data.eval.scenes");
    const RunConfig config = load_run_config(options.config, options.overrides);
    std::vector<OutputPath> sets;
    for (const auto& [key, file] : {std::pair("data.train.file", config.train.file), std::pair("data.eval.file", config.eval.file)})
      if (!file.empty()) sets.push_back({key, file});
    check_outputs(sets, std::vector<InputPath>{{.option = "--config", .path = options.config}});
    generate(config.train, config.env);
    generate(config.eval, config.env);
    if (!config.held_out_data.file.empty()) generate(config.held_out_data, config.env);
    return;
  }
  if (options.out.empty()) throw InputError("--out", "is missing", "name the file to write, for example --out episodes.json.gz");
  // The keys of --set are those of a run config: env.task.forward_m=0.25, data.train.filter.min_geodesic_m=2.
  RunConfig config = parse_run_config("", "--set", options.overrides);
  config.train.file = options.out;
  config.train.scenes = options.axes.applied_to(options.scenes);
  config.train.episodes_per_scene = options.count;
  config.train.goals_per_scene = options.goals;
  config.train.seed = options.seed;
  if (options.agents != 1) config.train.agents.count = options.agents;
  if (!options.agent_sounds.empty()) config.train.agents.sounds = {options.agent_sounds};
  validate(config.train.agents);
  if (!options.sounds.empty()) config.train.sounds = {options.sounds};
  if (config.train.sounds.empty()) config.train.sounds = {"synth:telephone"};
  generate(config.train, config.env);
}

}  // namespace

void add_dataset(CLI::App& app) {
  auto options = std::make_shared<DatasetArguments>();
  CLI::App* dataset = app.add_subcommand("dataset", "Generate episodes, corpora of room impulse responses, recordings and panoramas");
  dataset->require_subcommand(1);
  CLI::App* episodes =
      dataset->add_subcommand("episodes", "Draw random audio-visual navigation episodes and write them as AudioNav JSON(.gz)");
  episodes->add_option("SCENE", options->scenes, "Scenes (see 'earshot --help'); house:10..14,rooms=3 means five houses");
  options->axes.add_to(*episodes);
  episodes->add_option("--count", options->count, "Episodes per scene")->capture_default_str();
  episodes
      ->add_option(
          "--goals-per-scene", options->goals,
          "Number of source positions per scene, far from each other and shared by its episodes; 0: a separate position for each episode")
      ->capture_default_str();
  episodes->add_option("--out", options->out, "File to write; the ending .gz compresses it")->type_name(kOutputFile);
  episodes
      ->add_option("--sounds", options->sounds,
                   "Sounds of the goal: a folder of sound files, one sound file, or synth:KIND[:SEED] (kinds: telephone alarm music "
                   "noise speech click engine bird)")
      ->type_name("TEXT|DIR");
  episodes->add_option("--agents", options->agents, "Agents per episode; they have different start poses and the same goal")
      ->capture_default_str();
  episodes
      ->add_option("--agent-sounds", options->agent_sounds,
                   "Sounds that agents make for each other, in the form of --sounds (default: silent agents)")
      ->type_name("TEXT|DIR");
  episodes->add_option("--seed", options->seed, "Random seed")->capture_default_str();
  episodes->add_option("--config", options->config,
                       "Instead: write the sets data.train, data.eval and, if it is there, data.held_out of this run config");
  episodes->add_option("--set", options->overrides,
                       "Override a key of the run config: key=value, for example data.train.filter.min_geodesic_m=2; may be repeated");
  episodes->callback([options] { run_dataset(*options); });
  add_dataset_rir(*dataset);
  add_dataset_convolve(*dataset);
  add_dataset_scenes(*dataset);
  add_dataset_pano(*dataset);
  add_dataset_grid(*dataset);
}

}  // namespace earshot
