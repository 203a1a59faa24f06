// SPDX-License-Identifier: Apache-2.0
#pragma once

/// @file
/// Corpora on disk.  Each call writes a corpus, or completes one that was interrupted; every byte is a function of the config and the
/// program.  docs/howto/datasets.md describes keys and files.
///
/// Errors: InputError for a config that cannot work, or a folder that holds another corpus; RunError for a full disk.

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "earshot/config.h"

namespace earshot::api {

/// Where a corpus goes and how it is made.
struct CorpusOptions {
  std::filesystem::path out = {};
  int threads = 0;            ///< 0: all cores; any number gives the same bytes
  std::string shard = "1/1";  ///< "K/N": part K of N, for N machines
  /// Called from the caller's thread with the items written so far and in all.
  std::function<void(std::uint64_t done, std::uint64_t total)> progress = {};
};

/// What a call wrote.
struct CorpusReport {
  std::uint64_t written = 0;        ///< items of this call
  std::uint64_t total = 0;          ///< items of the whole corpus
  std::size_t folders_missing = 0;  ///< of other shards; 0: the corpus is complete and its manifests are written
  std::size_t left_out = 0;         ///< bad files that skip_bad leaves out
};

/// Room impulse responses with their labels, as `earshot dataset rir` (config: configs/datasets/rir.yaml), in sound files.
CorpusReport write_rir_corpus(const Config& config, const CorpusOptions& options);

/// Recordings of sound scenes with DCASE labels, as `earshot dataset scenes` (config: configs/datasets/scenes.yaml).
CorpusReport write_sound_scenes(const Config& config, const CorpusOptions& options);

/// Reverberant signals: dry speech through the responses of a corpus.
struct ConvolveOptions {
  std::filesystem::path corpus = {};  ///< that write_rir_corpus has completed
  std::filesystem::path speech = {};  ///< folder of sound files
  std::string noise = {};             ///< folder, `synth` (white noise) or synth:KIND; empty: none
  std::uint64_t seed = 0;
  std::uint64_t count = 0;  ///< signals; 0: one per speech file
  int min_talkers = 1, max_talkers = 1;
  bool early = false, dry = false, stems = false;  ///< further files for each talker: early part, dry speech, its part of the mixture
  /// Leave out files that cannot be used, and list them in inputs.jsonl; otherwise the first one is an InputError.
  bool skip_bad = false;
  /// Ranges over which the reverberation time (t20_mid_s, in seconds) and the direct-to-reverberant ratio (drr_db) of the first talker's
  /// response are uniform, in tenths; none: as in the corpus.  InputError where the corpus lacks such responses.
  std::optional<std::array<float, 2>> rt60_s = {}, drr_db = {};
};
/// As `earshot dataset convolve`.
CorpusReport write_convolved_corpus(const ConvolveOptions& convolve, const CorpusOptions& options);

}  // namespace earshot::api
