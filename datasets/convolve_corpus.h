// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "datasets/corpus_parts.h"
#include "datasets/inputs/wished_responses.h"
#include "sim/audio/dry_sounds/sound_file.h"

namespace earshot {

/// Reverberant signals: dry speech through the responses of a corpus, with noise.  A plain value.
struct ConvolveConfig {
  std::string corpus;                              ///< folder that write_rir_corpus has completed, or of measured responses
  bool measured = false;                           ///< `corpus` holds measured responses (measured_index.h)
  std::string speech;                              ///< folder of sound files, with those below it
  std::string noise;                               ///< the same, or synth (white noise), or synth:KIND; empty: none
  std::uint64_t seed = 0;                          ///< of all that is drawn
  std::uint64_t count = 0;                         ///< signals; 0: one per speech file.  Speech files come in turn
  int min_talkers = 1, max_talkers = 1;            ///< of different sources of a room, and different files where there are as many
  WishedRanges wished;                             ///< of the response of the first talker, whose room and place the others share
  std::vector<float> talker_db = {-5, 5};          ///< of further talkers over the first one
  std::vector<float> snr_db = {5, 25};             ///< all talkers over the noise
  std::vector<float> level_dbfs = {-30, -20};      ///< root of the mean square of the whole, over channels and time
  bool early = false, dry = false, stems = false;  ///< files besides, for each talker; see write_convolve_corpus
  bool cut = false;                                ///< ends with the direct sound of all speech; else when the last response is over
  bool skip_bad = false;                           ///< leave out sound files that are bad (corpus_inputs.h); else refuse them
  SoundFormat format = SoundFormat::wav;
  int signals_per_folder = 100;  ///< the unit of shards
};
/// Throws InputError "key = value: rule".
void validate(const ConvolveConfig& config);

struct ConvolveReport {
  std::uint64_t signals = 0, all_signals = 0;  ///< written by this run; of the whole
  std::uint64_t lowered = 0;                   ///< of all, once complete: below the level that was drawn, so that no sample exceeds 1
  std::size_t folders_missing = 0;
  std::size_t left_out = 0;                        ///< sound files, with skip_bad
  std::size_t speech_files = 0, without_text = 0;  ///< used; of these without a text
  std::size_t unused_texts = 0;                    ///< lines of *.trans.txt without a sound file
};

/// Writes signals, or completes what was begun (docs/howto/datasets_signals.md); every byte is a function of (config, files, program).
///
///   OUT/00000/0000007.wav              talkers and noise, channels as in the corpus
/// OUT/00000/0000007.t0.wav, .noise.wav   with `stems`: contribution of each talker and of the noise
///   OUT/00000/0000007.t0.early.wav     with `early`: the talker through the early part of its response
///   OUT/00000/0000007.t0.dry.wav       with `dry`: the dry speech, one channel, at the time and level of the direct sound of an
///                                      omnidirectional source: delayed by distance / speed of sound, to a fraction of a sample by
///                                      the kernel of responses (delayed_impulse.h), times 1 / (4 pi distance)
///   OUT/manifest.jsonl, recordings.jsonl, supervisions.jsonl
///   OUT/inputs.jsonl                   all sound files, and why some are left out (corpus_inputs.h)
///
/// All sound files and texts are opened before anything is written.  Every talker is heard to the end of its file: a signal is as long as
/// the one of them that ends last.
///
/// Sample 0 of all files of a signal is the moment at which the first talker's source emits the first sample of its file; direct sound is
/// heard from sample start_sample + direct_delay_s * rate on.  All files of a signal have one factor, below which no sample of any exceeds
/// 0.999.  Throws InputError, RunError.
ConvolveReport write_convolve_corpus(const ConvolveConfig& config, const CorpusRun& run);

}  // namespace earshot
