// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <memory>

#include "apps/commands.h"
#include "apps/dataset/corpus_command.h"
#include "apps/options/number_range.h"
#include "apps/options/output_options.h"
#include "datasets/convolve_corpus.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

struct DatasetConvolveArguments {
  ConvolveConfig config;
  CorpusTarget target;
  std::string talkers = "1", talker_level = "-5,5", snr = "5,25", level = "-30,-20", format = "wav", rt60, drr;
};

void run_dataset_convolve(const DatasetConvolveArguments& options) {
  ConvolveConfig config = options.config;
  const std::vector<float> talkers = parse_range(options.talkers, "--talkers");
  require(talkers[0] >= 1 && talkers[1] <= 100, "--talkers", options.talkers, "must be within [1, 100]");
  config.min_talkers = static_cast<int>(talkers[0]);
  config.max_talkers = static_cast<int>(talkers[1]);
  require(static_cast<float>(config.min_talkers) == talkers[0] && static_cast<float>(config.max_talkers) == talkers[1], "--talkers",
          options.talkers, "must be whole numbers");
  if (!options.rt60.empty()) config.wished.rt60_s = parse_range(options.rt60, "--rt60");
  if (!options.drr.empty()) config.wished.drr_db = parse_range(options.drr, "--drr");
  config.talker_db = parse_range(options.talker_level, "--talker-level");
  config.snr_db = parse_range(options.snr, "--snr");
  config.level_dbfs = parse_range(options.level, "--level");
  config.format = options.format == "wav" ? SoundFormat::wav : SoundFormat::flac;

  ConvolveReport report;
  const double seconds = write_with_progress(options.target, "dataset convolve", "signals",
                                             [&](const CorpusRun& run) { report = write_convolve_corpus(config, run); });
  fmt::print("{}: {} signals in {:.1f} s, {:.1f} per second\n", options.target.out, report.signals, seconds,
             static_cast<double>(report.signals) / seconds);
  print_state(options.target, report.folders_missing,
              fmt::format("{} signals; manifest.jsonl, recordings.jsonl, supervisions.jsonl", report.all_signals));
  print_left_out(options.target, report.left_out);
  if (report.without_text > 0 && report.without_text < report.speech_files)
    fmt::print("{}: {} of {} speech files have no text\n", options.target.out, report.without_text, report.speech_files);
  if (report.unused_texts > 0) fmt::print("{}: {} lines of *.trans.txt name no sound file\n", options.target.out, report.unused_texts);
  if (report.folders_missing == 0 && report.lowered > 0)
    fmt::print("{} signals are quieter than drawn, so that no sample exceeds 1 (`lowered` in the manifest); a lower --level avoids this\n",
               report.lowered);
}

}  // namespace

void add_dataset_convolve(CLI::App& dataset) {
  auto options = std::make_shared<DatasetConvolveArguments>();
  ConvolveConfig& config = options->config;
  CLI::App* command = dataset.add_subcommand(
      "convolve", "Convolve dry speech with the responses of a corpus, and add noise, targets and labels (docs/howto/datasets_signals.md)");
  command->add_option("CORPUS", config.corpus, "Folder written by 'earshot dataset rir', or with --measured one of measured responses")
      ->type_name(kWholeFolder)
      ->required();
  command->add_flag("--measured", config.measured,
                    "CORPUS holds sound files of measured responses, with or without places.yaml (docs/howto/measured_rooms.md)");
  command
      ->add_option("--speech", config.speech,
                   "Folder of dry speech, including subfolders: WAV, FLAC, OGG, Opus, MP3 or AIFF at any sample rate")
      ->type_name(kWholeFolder)
      ->required();
  add_out_option(*command, options->target);
  command->add_option("--count", config.count, "Number of signals; speech files are used in turn; 0: one signal per speech file")
      ->capture_default_str();
  command->add_option("--rt60", options->rt60,
                      "LOW,HIGH in s: draw the response of the first talker so that its reverberation time (t20_mid_s) is uniform in this "
                      "range, in tenths of it (default: as in the corpus)");
  command->add_option("--drr", options->drr, "LOW,HIGH in dB: the same for the direct-to-reverberant ratio (drr_db)");
  command->add_option("--talkers", options->talkers, "N or LOW,HIGH: number of talkers, each at a different source of the room")
      ->capture_default_str();
  command
      ->add_option("--talker-level", options->talker_level,
                   "LOW,HIGH in dB: level of further talkers relative to the first, at the listener")
      ->capture_default_str();
  command
      ->add_option("--noise", config.noise,
                   "Noise: a folder of noise files, synth (white) or synth:KIND. It is convolved with the response of another source of "
                   "the room; in a room with one source, each channel gets uncorrelated noise")
      ->type_name("TEXT|DIR");
  command->add_option("--snr", options->snr, "LOW,HIGH in dB: ratio of all talkers to noise, over all channels and the whole signal")
      ->capture_default_str();
  command->add_option("--level", options->level, "LOW,HIGH in dB: RMS level of a signal relative to full scale")->capture_default_str();
  command->add_flag("--early", config.early,
                    "Also write each talker convolved with the early part of the response (split_ms of the corpus)");
  command->add_flag("--dry", config.dry,
                    "Also write each talker dry, delayed (to a fraction of a sample) and scaled like the direct sound. Sample 0 of every "
                    "file is the moment at which the first talker's file starts at its source");
  command->add_flag("--stems", config.stems, "Also write each talker and the noise as separate files");
  command->add_flag("--cut", config.cut,
                    "Cut the signal at the end of the direct sound of all speech instead of the end of its reverberation");
  command->add_flag("--skip-bad", config.skip_bad, kSkipBadHelp);
  command->add_option("--format", options->format, "Sound format: wav (32-bit float) or flac (24 bits)")
      ->check(CLI::IsMember({"wav", "flac"}))
      ->capture_default_str();
  command->add_option("--seed", config.seed, "Random seed")->capture_default_str();
  command
      ->add_option("--signals-per-folder", config.signals_per_folder,
                   "Signals per folder, the unit of --shard: 1 to 10, or a multiple of 10")
      ->capture_default_str();
  add_sharing_options(*command, options->target);
  command->callback([options] { run_dataset_convolve(*options); });
}

}  // namespace earshot
