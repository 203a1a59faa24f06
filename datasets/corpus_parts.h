#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "datasets/rir_corpus.h"
#include "datasets/rir_corpus_folder.h"

namespace earshot {

/// Writes the files of one part of a corpus, each as soon as it is made, and keeps the lines of its manifest.
class CorpusPartWriter {
 public:
  CorpusPartWriter(const CorpusFolder& folder, std::size_t part) : folder_(folder), part_(part) {}
  /// Returns the path within the corpus.
  std::string write(const std::string& name, std::string_view bytes);
  /// line: without its line feed.
  void add_line(const std::string& line) { lines_ += line + "\n"; }
  /// All is written: makes it last.
  void finish() const { folder_.finish_room(part_, names_, lines_); }

 private:
  const CorpusFolder& folder_;
  std::size_t part_;
  std::vector<std::string> names_;
  std::string lines_;
};

/// Makes one part; a function of the part alone.  count_item: called after each recording of it, for the progress.
using MakeCorpusPart = std::function<void(std::size_t part, CorpusPartWriter& writer, const std::function<void()>& count_item)>;

struct CorpusParts {
  std::function<std::uint64_t(std::size_t)> items;  ///< recordings of a part
  std::function<MakeCorpusPart()> make_worker;      ///< called once per thread, from that thread
  std::vector<DerivedManifest> derived;
};

struct CorpusPartsReport {
  std::uint64_t items = 0;  ///< written by this run
  std::size_t folders_missing = 0;
};

/// Parts of the folders of a shard that are not there.
std::vector<std::size_t> missing_parts(const CorpusFolder& folder, const CorpusShard& shard);

/// Writes the parts of this shard that are not there, on run.threads threads, then the manifests of the whole if no folder is missing.
/// The bytes depend on neither threads nor shards if the parts do not.  Throws what a part throws; what was finished before stays.
CorpusPartsReport complete_corpus(const CorpusFolder& folder, const CorpusRun& run, const CorpusParts& parts);

}  // namespace earshot
