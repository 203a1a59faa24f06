#include "apps/corpus_command.h"

#include <fmt/format.h>

#include <chrono>
#include <cstdint>
#include <memory>

#include "sim/base/progress.h"
#include "sim/sofa/sofa_writer.h"

namespace earshot {

double write_with_progress(const CorpusTarget& target, const std::string& command, const std::string& unit,
                           const std::function<void(const CorpusRun& run)>& write) {
  std::unique_ptr<Progress> progress;  // begins with the first call, which knows the total
  const auto begin = std::chrono::steady_clock::now();
  CorpusRun run{.out = target.out,
                .threads = target.threads,
                .shard = CorpusShard::parse(target.shard),
                .progress = [&](std::uint64_t done, std::uint64_t total) {
                  if (!progress) progress = std::make_unique<Progress>(command, unit, total);
                  progress->update(done);
                }};
  if (can_write_sofa()) run.encode_sofa = encode_sofa;
  write(run);
  progress.reset();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

void print_missing_folders(const CorpusTarget& target, std::size_t count) {
  fmt::print("{}: {} folders are missing, which other shards write; run any shard again once all are here\n", target.out, count);
}

}  // namespace earshot
