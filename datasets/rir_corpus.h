#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

#include "datasets/rir_corpus_config.h"
#include "sim/sofa/sofa_room_responses.h"

namespace earshot {

/// Part `index` of `count`, counted from 1: the folders whose number leaves index - 1 when divided by count.
struct CorpusShard {
  int index = 1, count = 1;
  /// "K/N".  Throws InputError.
  static CorpusShard parse(const std::string& text);
};

struct CorpusRun {
  std::filesystem::path out;
  int threads = 0;  ///< over rooms, and over the sources of the last ones; 0: all cores
  CorpusShard shard;
  /// Called from the caller's thread with the responses written so far and in all, of those that were missing.
  std::function<void(std::uint64_t done, std::uint64_t total)> progress;
  /// sofa_writer.h's, for corpora that ask for SOFA: who calls decides whether HDF5 is linked.
  std::function<std::string(const SofaRoomResponses& responses, const std::string& where)> encode_sofa = {};
};

struct CorpusReport {
  std::uint64_t rooms = 0, responses = 0;  ///< written by this run
  std::uint64_t all_responses = 0;         ///< of the corpus
  std::size_t folders_missing = 0;         ///< of other shards; 0: the manifests of the whole corpus are written
};

/// Writes a corpus of responses, or completes one (docs/datasets.md).  Every byte is a function of (config, program), not of threads,
/// shards or how often the run was killed; a room is begun again if its line in the folder is missing.
///
///   OUT/corpus.json                   config, program, channels: what is compared before a corpus is completed
///   OUT/00000/000000_s00_l0000.wav    room, source, listener; with a split .early.wav and .late.wav beside it
///   OUT/00000/000000_s00_l0000.rgb.png   with config.panorama; .depth.png and .category.png likewise (rir_corpus_pictures.h)
///   OUT/00000/manifest.jsonl          one line per response; written last, when all rooms of the folder are there
///   OUT/manifest.jsonl                all of them, once no folder is missing
///   OUT/00000/000000_s00.sofa         with config.sofa in their place: the listeners of a source; no recordings.jsonl then
///   OUT/recordings.jsonl              the same files as lhotse's RecordingSet
///
/// Throws InputError: a corpus of another config or program in `out`, a scene that cannot be used; RunError: disk full.
CorpusReport write_rir_corpus(const RirCorpusConfig& config, const CorpusRun& run);

}  // namespace earshot
