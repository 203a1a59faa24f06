#include <fmt/format.h>

#include <chrono>
#include <memory>

#include "apps/commands.h"
#include "envs/rir_corpus.h"
#include "sim/base/errors.h"
#include "sim/base/progress.h"
#include "sim/sofa/sofa_writer.h"

namespace earshot {
namespace {

struct Options {
  std::string config, out, shard = "1/1";
  std::vector<std::string> overrides;
  int threads = 0;
  bool sofa = false;
};

void run_dataset_rir(const Options& options) {
  std::vector<std::string> overrides = options.overrides;
  if (options.sofa) overrides.emplace_back("sofa=true");
  const RirCorpusConfig config = load_rir_corpus_config(options.config, overrides);
  std::unique_ptr<Progress> progress;
  const auto begin = std::chrono::steady_clock::now();
  CorpusRun run{.out = options.out,
                .threads = options.threads,
                .shard = CorpusShard::parse(options.shard),
                .progress = [&](std::uint64_t done, std::uint64_t total) {
                  if (!progress) progress = std::make_unique<Progress>("dataset rir", "responses", total);
                  progress->update(done);
                }};
  if (can_write_sofa()) run.encode_sofa = encode_sofa;
  const CorpusReport report = write_rir_corpus(config, run);
  progress.reset();
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  fmt::print("{}: {} responses of {} rooms in {:.1f} s, {:.1f} per second\n", options.out, report.responses, report.rooms, seconds,
             static_cast<double>(report.responses) / seconds);
  if (report.folders_missing == 0)
    fmt::print("{}: complete, {} responses; manifest.jsonl{}\n", options.out, report.all_responses,
               config.sofa ? "" : ", recordings.jsonl");
  else
    fmt::print("{}: {} folders are missing, which other shards write; run any shard again once all are here\n", options.out,
               report.folders_missing);
}

}  // namespace

void add_dataset_rir(CLI::App& dataset) {
  auto options = std::make_shared<Options>();
  CLI::App* command = dataset.add_subcommand(
      "rir", "Write a corpus of room impulse responses with their labels, or complete one that was interrupted (docs/datasets.md)");
  command->add_option("CONFIG", options->config, "YAML file with rooms, sources, listeners and acoustics, as configs/datasets/rir.yaml")
      ->required();
  command->add_option("--out", options->out, "Folder to write; the same command completes it after an interruption")->required();
  command->add_option("--set", options->overrides, "key=value over the config, for example acoustics.field_error=0.03");
  command->add_flag("--sofa", options->sofa, "SOFA files (SingleRoomSRIR 1.0), one per source, in place of sound files; as sofa=true");
  command->add_option("--threads", options->threads, "Threads; 0: all cores; any number gives the same bytes")->capture_default_str();
  command->add_option("--shard", options->shard, "K/N: the K-th of N parts, for N machines; any N gives the same bytes")
      ->capture_default_str();
  command->callback([options] { run_dataset_rir(*options); });
}

}  // namespace earshot
