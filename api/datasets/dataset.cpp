// SPDX-License-Identifier: Apache-2.0
#include "earshot/dataset.h"

#include "datasets/convolve_corpus.h"
#include "datasets/rir_corpus.h"
#include "datasets/sound_scene_corpus.h"
#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"

namespace earshot::api {
namespace {

CorpusRun corpus_run(const CorpusOptions& options) {
  return {.out = options.out, .threads = options.threads, .shard = CorpusShard::parse(options.shard), .progress = options.progress};
}

template <class CorpusConfig>
CorpusConfig read_corpus_config(const Config& text) {
  CorpusConfig config;
  ConfigReader reader = ConfigReader::from_text(text.yaml, text.where, text.overrides.texts());
  read(reader, config);
  reader.finish();
  validate(config);
  return config;
}

}  // namespace

CorpusReport write_rir_corpus(const Config& config, const CorpusOptions& options) {
  const auto rir_config = read_corpus_config<RirCorpusConfig>(config);
  if (rir_config.sofa) throw InputError("sofa", "is written by the program alone", "use earshot dataset rir --sofa, or leave it out");
  const earshot::CorpusReport report = earshot::write_rir_corpus(rir_config, corpus_run(options));
  return {report.responses, report.all_responses, report.folders_missing, 0};
}

CorpusReport write_sound_scenes(const Config& config, const CorpusOptions& options) {
  const SoundSceneReport report = earshot::write_sound_scenes(read_corpus_config<SoundSceneConfig>(config), corpus_run(options));
  return {report.recordings, report.all_recordings, report.folders_missing, 0};
}

CorpusReport write_convolved_corpus(const ConvolveOptions& convolve, const CorpusOptions& options) {
  ConvolveConfig config;
  config.corpus = convolve.corpus.string();
  config.speech = convolve.speech.string();
  config.noise = convolve.noise;
  config.seed = convolve.seed;
  config.count = convolve.count;
  config.min_talkers = convolve.min_talkers;
  config.max_talkers = convolve.max_talkers;
  config.early = convolve.early;
  config.dry = convolve.dry;
  config.stems = convolve.stems;
  config.skip_bad = convolve.skip_bad;
  if (convolve.rt60_s) config.wished.rt60_s.assign(convolve.rt60_s->begin(), convolve.rt60_s->end());
  if (convolve.drr_db) config.wished.drr_db.assign(convolve.drr_db->begin(), convolve.drr_db->end());
  validate(config);
  const ConvolveReport report = write_convolve_corpus(config, corpus_run(options));
  return {report.signals, report.all_signals, report.folders_missing, report.left_out};
}

}  // namespace earshot::api
