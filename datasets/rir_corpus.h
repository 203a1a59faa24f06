// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

#include "datasets/corpus_parts.h"
#include "datasets/rir_corpus_config.h"

namespace earshot {

struct CorpusReport {
  std::uint64_t rooms = 0, responses = 0;  ///< written by this run
  std::uint64_t all_responses = 0;         ///< of the corpus
  std::size_t folders_missing = 0;         ///< of other shards; 0: the manifests of the whole corpus are written
};

/// Writes a corpus of responses, or completes one (docs/howto/datasets.md).  Every byte is a function of (config, program), not of threads,
/// shards or how often the run was killed; a room is begun again if its line in the folder is missing.
///
/// OUT/corpus.json                   config, program, channels: compared before a corpus is completed
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
