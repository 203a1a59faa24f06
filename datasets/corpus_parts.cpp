#include "datasets/corpus_parts.h"

#include <atomic>

#include "datasets/corpus_threads.h"
#include "sim/base/errors.h"

namespace earshot {
std::string CorpusPartWriter::write(const std::string& name, std::string_view bytes) {
  folder_.write_sound(part_, name, bytes);
  names_.push_back(name);
  return folder_.prefix_of(part_) + name;
}

CorpusPartsReport complete_corpus(const CorpusFolder& folder, const CorpusRun& run, const CorpusParts& parts) {
  require(run.threads >= 0 && run.threads <= 1024, "--threads", run.threads, "must be in [0, 1024]; 0 means all cores");
  const std::vector<std::size_t> missing = missing_parts(folder, run.shard);
  CorpusPartsReport report;
  if (!missing.empty()) {
    std::uint64_t total = 0;
    for (const std::size_t part : missing) total += parts.items(part);
    CorpusThreads threads;
    std::atomic<std::size_t> next = 0;
    threads.run(run.threads, missing.size(), total, run.progress, [&] {
      MakeCorpusPart make;
      for (std::size_t i = next++; i < missing.size() && !threads.failed(); i = next++) {
        if (!make) make = parts.make_worker();
        CorpusPartWriter writer(folder, missing[i]);
        make(missing[i], writer, [&threads] { threads.count_item(); });
        writer.finish();
      }
    });
    report.items = threads.items();
  }
  report.folders_missing = folder.join_manifests(parts.derived);
  return report;
}

std::vector<std::size_t> missing_parts(const CorpusFolder& folder, const CorpusShard& shard) {
  std::vector<std::size_t> missing;
  for (std::size_t number = 0; number < folder.count(); ++number)
    if (number % static_cast<std::size_t>(shard.count) == static_cast<std::size_t>(shard.index - 1)) {
      const std::vector<std::size_t> left = folder.missing_rooms(number);
      missing.insert(missing.end(), left.begin(), left.end());
    }
  return missing;
}

}  // namespace earshot
