// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "datasets/corpus_folder.h"
#include "sim/sofa/sofa_room_responses.h"

namespace earshot {

/// Part `index` of `count`, counted from 1: the folders whose number leaves index - 1 when divided by count.
struct CorpusShard {
  int index = 1, count = 1;
  /// "K/N".  Throws InputError.
  static CorpusShard parse(const std::string& text);
  [[nodiscard]] bool has(std::size_t folder) const {
    return folder % static_cast<std::size_t>(count) == static_cast<std::size_t>(index - 1);
  }
};

struct CorpusRun {
  std::filesystem::path out;
  int threads = 0;  ///< over parts, and over the pieces of the last ones; 0: all cores
  CorpusShard shard;
  /// Called from the caller's thread with the recordings written so far and in all, of those that were missing.
  std::function<void(std::uint64_t done, std::uint64_t total)> progress;
  /// The same with the sound files opened so far and in all, before the first recording.
  std::function<void(std::uint64_t opened, std::uint64_t total)> opening = {};
  /// sofa_writer.h's, for corpora in SOFA: the caller decides whether HDF5 is linked.
  std::function<std::string(const SofaRoomResponses& responses, const std::string& where)> encode_sofa = {};
};

/// Throws InputError.  To be called before anything is written.
void validate(const CorpusRun& run);

/// Writes the files of one piece of a part, each as soon as it is made, and keeps their names and the lines of its manifest.
class CorpusPieceWriter {
 public:
  CorpusPieceWriter(const CorpusFolder& folder, std::size_t part) : folder_(folder), part_(part) {}
  /// Returns the path within the corpus.
  std::string write(const std::string& name, std::string_view bytes);
  /// line: without its line feed.
  void add_line(const std::string& line) { lines_ += line + "\n"; }
  [[nodiscard]] const std::vector<std::string>& names() const { return names_; }
  [[nodiscard]] const std::string& lines() const { return lines_; }

 private:
  const CorpusFolder& folder_;
  std::size_t part_;
  std::vector<std::string> names_;
  std::string lines_;
};

/// A part is written whole or not at all; several threads may make its pieces.
struct CorpusPiece {
  std::size_t part = 0;
  int number = 0;  ///< in the part, from 0
};

/// Makes one piece; a function of the piece alone.  count_item: to be called after each recording of it, for the progress; where another
/// thread has failed it throws, to end this one.
using MakeCorpusPiece = std::function<void(CorpusPiece piece, CorpusPieceWriter& writer, const std::function<void()>& count_item)>;

struct CorpusParts {
  int pieces = 1;                                        ///< of each part
  std::function<std::uint64_t(std::size_t part)> items;  ///< recordings of a part
  std::function<void(std::size_t part)> begin = {};      ///< called before the pieces of a part, from one thread; loads what they share
  std::function<void(std::size_t part)> end = {};        ///< called after the last of them, from one thread
  std::function<MakeCorpusPiece()> make_worker;          ///< called once per thread, from that thread
  std::vector<DerivedManifest> derived = {};
};

struct CorpusPartsReport {
  std::uint64_t parts = 0, items = 0;  ///< written by this run
  std::size_t folders_missing = 0;     ///< of other shards; 0: the manifests of the whole corpus are written
};

/// Writes the parts of this shard that are not there, on run.threads threads, then the manifests of the whole if no folder is missing.
/// Threads begin the parts in their order; when none is left, they take pieces of parts that others work on.  The bytes depend on neither
/// threads nor shards if the pieces do not.  Throws what a piece throws; parts that were finished before stay.
CorpusPartsReport complete_corpus(const CorpusFolder& folder, const CorpusRun& run, const CorpusParts& parts);

}  // namespace earshot
