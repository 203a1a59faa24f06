// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <memory>

#include "apps/commands.h"
#include "apps/dataset/corpus_command.h"
#include "datasets/sound_scene_corpus.h"

namespace earshot {
namespace {

struct DatasetScenesArguments {
  CorpusTarget target;
  std::string config;
  std::vector<std::string> overrides;
  bool skip_bad = false;
};

void run_dataset_scenes(const DatasetScenesArguments& options) {
  std::vector<std::string> overrides = options.overrides;
  if (options.skip_bad) overrides.emplace_back("skip_bad=true");
  const SoundSceneConfig config = load_sound_scene_config(options.config, overrides);
  SoundSceneReport report;
  const double seconds = write_with_progress(options.target, "dataset scenes", "recordings",
                                             [&](const CorpusRun& run) { report = write_sound_scenes(config, run); });
  fmt::print("{}: {} recordings of {} s in {:.1f} s\n", options.target.out, report.recordings, config.duration_s, seconds);
  print_state(options.target, report.folders_missing,
              fmt::format("{} recordings; manifest.jsonl, recordings.jsonl, supervisions.jsonl, one CSV file next to each recording",
                          report.all_recordings));
  print_left_out(options.target, report.left_out);
}

}  // namespace

void add_dataset_scenes(CLI::App& dataset) {
  auto options = std::make_shared<DatasetScenesArguments>();
  CLI::App* command = dataset.add_subcommand("scenes",
                                             "Write recordings of static and moving sound events, with DCASE labels of class, direction "
                                             "and distance (docs/howto/datasets_signals.md)");
  command
      ->add_option("CONFIG", options->config,
                   "Config (YAML) with rooms, classes, events and acoustics, for example configs/datasets/scenes.yaml")
      ->required();
  add_out_option(*command, options->target);
  command->add_option("--set", options->overrides, "Override a key of the config: key=value, for example max_overlap=1; may be repeated");
  command->add_flag("--skip-bad", options->skip_bad, std::string(kSkipBadHelp) + "; same as skip_bad=true");
  add_sharing_options(*command, options->target);
  command->callback([options] { run_dataset_scenes(*options); });
}

}  // namespace earshot
