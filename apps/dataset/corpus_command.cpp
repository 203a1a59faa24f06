// SPDX-License-Identifier: Apache-2.0
#include "apps/dataset/corpus_command.h"

#include <fmt/format.h>

#include <chrono>
#include <cstdint>
#include <memory>

#include "apps/options/output_options.h"
#include "sim/base/process/progress.h"
#include "sim/sofa/sofa_writer.h"

namespace earshot {

void add_out_option(CLI::App& command, CorpusTarget& target) {
  command.add_option("--out", target.out, "Folder to write; run the same command again to complete an interrupted corpus")
      ->type_name(kOutputFolder)
      ->required();
}

void add_sharing_options(CLI::App& command, CorpusTarget& target, const std::string& parts) {
  command.add_option("--threads", target.threads, "Threads; 0: all cores; the number does not change the files")->capture_default_str();
  command.add_option("--shard", target.shard, "K/N: write only part K of N, " + parts + "; N does not change the files")
      ->capture_default_str();
}

double write_with_progress(const CorpusTarget& target, const std::string& command, const std::string& unit,
                           const std::function<void(const CorpusRun& run)>& write) {
  std::unique_ptr<Progress> opening, progress;  // each begins with its first call, which knows the total
  const auto begin = std::chrono::steady_clock::now();
  CorpusRun run{.out = target.out,
                .threads = target.threads,
                .shard = CorpusShard::parse(target.shard),
                .progress =
                    [&](std::uint64_t done, std::uint64_t total) {
                      opening.reset();
                      if (!progress) progress = std::make_unique<Progress>(command, unit, total);
                      progress->update(done);
                    },
                .opening =
                    [&](std::uint64_t opened, std::uint64_t total) {
                      if (!opening) opening = std::make_unique<Progress>(command, "files opened", total);
                      opening->update(opened);
                    }};
  if (can_write_sofa()) run.encode_sofa = encode_sofa;
  write(run);
  opening.reset();
  progress.reset();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

void print_state(const CorpusTarget& target, std::size_t folders_missing, const std::string& complete) {
  if (folders_missing == 0)
    fmt::print("{}: complete, {}\n", target.out, complete);
  else
    fmt::print("{}: {} folders of other shards are missing; run any shard again when all shards are in this folder\n", target.out,
               folders_missing);
}

void print_left_out(const CorpusTarget& target, std::size_t left_out) {
  if (left_out > 0) fmt::print("{}: {} bad sound files are left out (left_out in inputs.jsonl)\n", target.out, left_out);
}

}  // namespace earshot
