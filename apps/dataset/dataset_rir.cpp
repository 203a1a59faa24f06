// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <memory>

#include "apps/commands.h"
#include "apps/dataset/corpus_command.h"
#include "datasets/rir_corpus.h"

namespace earshot {
namespace {

struct DatasetRirArguments {
  CorpusTarget target;
  std::string config;
  std::vector<std::string> overrides;
  bool sofa = false;
};

void run_dataset_rir(const DatasetRirArguments& options) {
  std::vector<std::string> overrides = options.overrides;
  if (options.sofa) overrides.emplace_back("sofa=true");
  const RirCorpusConfig config = load_rir_corpus_config(options.config, overrides);
  CorpusReport report;
  const double seconds = write_with_progress(options.target, "dataset rir", "responses",
                                             [&](const CorpusRun& run) { report = write_rir_corpus(config, run); });
  fmt::print("{}: {} responses of {} rooms in {:.1f} s, {:.1f} per second\n", options.target.out, report.responses, report.rooms, seconds,
             static_cast<double>(report.responses) / seconds);
  print_state(options.target, report.folders_missing,
              fmt::format("{} responses; manifest.jsonl{}", report.all_responses, config.sofa ? "" : ", recordings.jsonl"));
}

}  // namespace

void add_dataset_rir(CLI::App& dataset) {
  auto options = std::make_shared<DatasetRirArguments>();
  CLI::App* command = dataset.add_subcommand(
      "rir", "Write a corpus of room impulse responses with labels, or complete an interrupted one (docs/howto/datasets.md)");
  command
      ->add_option("CONFIG", options->config,
                   "Config (YAML) with rooms, sources, listeners and acoustics, for example configs/datasets/rir.yaml")
      ->required();
  add_out_option(*command, options->target);
  command->add_option("--set", options->overrides,
                      "Override a key of the config: key=value, for example acoustics.field_error=0.03; may be repeated");
  command->add_flag("--sofa", options->sofa,
                    "Write SOFA files (SingleRoomSRIR 1.0), one per source, instead of sound files; same as sofa=true");
  add_sharing_options(*command, options->target);
  command->callback([options] { run_dataset_rir(*options); });
}

}  // namespace earshot
