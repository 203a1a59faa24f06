#include <fmt/format.h>

#include <chrono>
#include <memory>

#include "apps/commands.h"
#include "envs/sound_scene_corpus.h"
#include "sim/base/progress.h"

namespace earshot {
namespace {

struct Options {
  std::string config, out, shard = "1/1";
  std::vector<std::string> overrides;
  int threads = 0;
};

void run_dataset_scenes(const Options& options) {
  const SoundSceneConfig config = load_sound_scene_config(options.config, options.overrides);
  std::unique_ptr<Progress> progress;
  const auto begin = std::chrono::steady_clock::now();
  const SoundSceneReport report = write_sound_scenes(config, {.out = options.out,
                                                              .threads = options.threads,
                                                              .shard = CorpusShard::parse(options.shard),
                                                              .progress = [&](std::uint64_t done, std::uint64_t total) {
                                                                if (!progress)
                                                                  progress =
                                                                      std::make_unique<Progress>("dataset scenes", "recordings", total);
                                                                progress->update(done);
                                                              }});
  progress.reset();
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  fmt::print("{}: {} recordings of {} s in {:.1f} s\n", options.out, report.recordings, config.duration_s, seconds);
  if (report.folders_missing == 0)
    fmt::print("{}: complete, {} recordings; manifest.jsonl, recordings.jsonl, supervisions.jsonl, a CSV beside each recording\n",
               options.out, report.all_recordings);
  else
    fmt::print("{}: {} folders are missing, which other shards write; run any shard again once all are here\n", options.out,
               report.folders_missing);
}

}  // namespace

void add_dataset_scenes(CLI::App& dataset) {
  auto options = std::make_shared<Options>();
  CLI::App* command = dataset.add_subcommand(
      "scenes", "Record sound events at rest and on the move, with DCASE labels of class, direction and distance (docs/datasets.md)");
  command->add_option("CONFIG", options->config, "YAML file with rooms, classes, events and acoustics, as configs/datasets/scenes.yaml")
      ->required();
  command->add_option("--out", options->out, "Folder to write; the same command completes it after an interruption")->required();
  command->add_option("--set", options->overrides, "key=value over the config, for example max_overlap=1");
  command->add_option("--threads", options->threads, "Threads; 0: all cores; any number gives the same bytes")->capture_default_str();
  command->add_option("--shard", options->shard, "K/N: the K-th of N parts, for N machines; any N gives the same bytes")
      ->capture_default_str();
  command->callback([options] { run_dataset_scenes(*options); });
}

}  // namespace earshot
