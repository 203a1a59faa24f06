// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <memory>

#include "apps/commands.h"
#include "apps/dataset/corpus_command.h"
#include "apps/options/output_options.h"
#include "apps/options/picture_size.h"
#include "apps/options/scene_options.h"
#include "datasets/rir_corpus.h"
#include "datasets/rir_corpus_room.h"
#include "sim/audio/head/listener_layout.h"
#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

struct DatasetPanoArguments {
  CorpusTarget target;
  std::vector<std::string> scenes, overrides;
  AxesOptions axes;
  std::string size = "1152x384", channels = "mono";
  int pairs = 100;
  float max_distance_m = 5, rate_hz = 44100, length_s = 1;
  std::uint64_t seed = 0;
};

RirCorpusConfig config_of(const DatasetPanoArguments& options) {
  RirCorpusConfig config;
  config.seed = options.seed;
  config.scenes = options.axes.applied_to(expand_scenes(options.scenes));
  config.sources_per_room = options.pairs;
  config.listeners_per_source = 1;
  config.max_distance_m = options.max_distance_m;
  config.channels = options.channels;
  config.acoustics = acoustic_preset("fast");
  const auto [width_px, height_px] = parse_picture_size(options.size, "1152x384");
  config.panorama = CorpusPanorama{.width_px = width_px, .height_px = height_px};
  config.rooms_per_folder = 1;
  // As overrides ahead of the user's, since `--set acoustics.preset=...` replaces all that was set before it.
  std::vector<std::string> overrides{fmt::format("acoustics.sample_rate_hz={}", options.rate_hz),
                                     fmt::format("acoustics.rir_length_s={}", options.length_s)};
  overrides.insert(overrides.end(), options.overrides.begin(), options.overrides.end());
  ConfigReader reader = ConfigReader::from_text("{}", "--set", overrides);
  read(reader, config);
  reader.finish();
  return config;
}

void run_dataset_pano(const DatasetPanoArguments& options) {
  const RirCorpusConfig config = config_of(options);
  CorpusReport report;
  const double seconds =
      write_with_progress(options.target, "dataset pano", "pairs", [&](const CorpusRun& run) { report = write_rir_corpus(config, run); });
  fmt::print("{}: {} panoramas with a response in {:.1f} s, {:.1f} per second\n", options.target.out, report.responses, seconds,
             static_cast<double>(report.responses) / seconds);
  print_state(options.target, report.folders_missing,
              fmt::format("{} pairs; manifest.jsonl{}", report.all_responses, config.sofa ? "" : ", recordings.jsonl"));
}

}  // namespace

void add_dataset_pano(CLI::App& dataset) {
  auto options = std::make_shared<DatasetPanoArguments>();
  CLI::App* command = dataset.add_subcommand("pano",
                                             "Write panoramas (color, depth, category), each with a response at the same pose, in the form "
                                             "of the PanoIR sets (docs/howto/datasets.md)");
  command->add_option("SCENE", options->scenes, "Scenes and folders of scenes; house:10..14 means five houses")
      ->type_name("TEXT|DIR")
      ->required();
  options->axes.add_to(*command);
  add_out_option(*command, options->target);
  command->add_option("--pairs", options->pairs, "Pairs of source and listener per scene")->capture_default_str();
  command
      ->add_option("--size", options->size,
                   "WIDTHxHEIGHT in pixels (equirectangular: the width spans 360 degrees, pixels are square in angle)")
      ->capture_default_str();
  command->add_option("--channels", options->channels, "Channels of the responses: " + std::string(kListenerLayouts))
      ->capture_default_str();
  command->add_option("--rate", options->rate_hz, "Sample rate of the responses in Hz")->capture_default_str();
  command->add_option("--length", options->length_s, "Length of the responses in seconds")->capture_default_str();
  command->add_option("--max-distance", options->max_distance_m, "Largest distance between source and listener in metres")
      ->capture_default_str();
  command->add_option("--seed", options->seed, "Random seed")->capture_default_str();
  command->add_option("--set", options->overrides,
                      "Set a key of a `dataset rir` config: key=value, for example acoustics.rays=64; may be repeated");
  add_sharing_options(*command, options->target, "split by scenes");
  command->callback([options] { run_dataset_pano(*options); });
}

}  // namespace earshot
