// SPDX-License-Identifier: Apache-2.0
#include "datasets/convolve_corpus.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "datasets/corpus_parts.h"
#include "datasets/inputs/corpus_inputs.h"
#include "datasets/inputs/transcripts.h"
#include "datasets/labels/label_number.h"
#include "datasets/response_index.h"
#include "datasets/reverberant_mixture.h"
#include "sim/audio/head/loudspeaker_layout.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"
#include "sim/base/text/listed.h"

namespace earshot {
namespace {

using Json = nlohmann::ordered_json;

/// Signals that a killed run may have to make again.
constexpr int kSignalsPerPart = 10;
/// Of what a mixture is for given settings and files: corpora of other versions are not completed.
constexpr int kMixingVersion = 3;

void validate_range(const std::vector<float>& range, const std::string& key, float low, float high) {
  const bool ok = range.size() == 2 && range[0] >= low && range[1] <= high && range[0] <= range[1];
  require(ok, key, listed(range, ","), fmt::format("must be LOW,HIGH in [{}, {}] dB with LOW <= HIGH", low, high));
}

/// What is mixed.
struct ConvolveSounds {
  SoundFolder speech;
  std::optional<SoundFolder> noise;  ///< none, or noise that is synthesized
  Transcripts transcripts;
  [[nodiscard]] const SoundFolder* noise_folder() const { return noise ? &*noise : nullptr; }
};

bool names_folder(const std::string& noise) { return !noise.empty() && noise != "synth" && !noise.starts_with("synth:"); }

/// Keys of the lines that depend on the files.
std::set<std::string> keys_of_files(const ConvolveConfig& config) {
  std::set<std::string> keys{"speech_files", "speech_hash", "transcripts_hash"};
  if (names_folder(config.noise)) keys.insert("noise");
  if (config.count == 0) keys.insert("signals");
  return keys;
}

/// sounds: null to leave out what depends on them.
std::string config_lines(const ConvolveConfig& config, const ResponseIndex& index, const ConvolveSounds* sounds, std::uint64_t signals) {
  const auto range = [](const std::vector<float>& values) { return fmt::format("[{}, {}]", values[0], values[1]); };
  std::string text;
  const auto add = [&](const std::string& key, const auto& value) { text += fmt::format("{}: {}\n", key, value); };
  add("corpus_hash", hex64(index.hash()));
  if (sounds) {
    add("speech_files", sounds->speech.files.size());
    add("speech_hash", hex64(sounds->speech.hash()));
    add("transcripts_hash", hex64(sounds->transcripts.hash(sounds->speech)));
  }
  if (sounds || !names_folder(config.noise))
    add("noise", sounds && sounds->noise ? "folder " + hex64(sounds->noise->hash()) : config.noise.empty() ? "none" : config.noise);
  add("seed", config.seed);
  add("signals", signals);
  add("rt60_s", config.wished.rt60_s.empty() ? "all" : range(config.wished.rt60_s));
  add("drr_db", config.wished.drr_db.empty() ? "all" : range(config.wished.drr_db));
  add("talkers", fmt::format("[{}, {}]", config.min_talkers, config.max_talkers));
  add("talker_db", range(config.talker_db));
  add("snr_db", range(config.snr_db));
  add("level_dbfs", range(config.level_dbfs));
  add("early", config.early);
  add("dry", config.dry);
  add("stems", config.stems);
  add("cut", config.cut);
  add("format", config.format == SoundFormat::wav ? "wav" : "flac");
  add("signals_per_folder", config.signals_per_folder);
  add("skip_bad", config.skip_bad);
  add("mixing_version", kMixingVersion);
  return text;
}

/// Lists the folders and opens all files.  Throws InputError.
CorpusInputs open_inputs(const ConvolveConfig& config, const CorpusRun& run, float sample_rate_hz, const ConvolveSounds& sounds) {
  std::vector<InputFile> files;
  for (const std::string& file : sounds.speech.files) {
    const auto unreadable = sounds.transcripts.unreadable().find(file);
    files.push_back({.group = "speech",
                     .name = file,
                     .path = sounds.speech.root / file,
                     .reason = unreadable == sounds.transcripts.unreadable().end() ? std::string() : unreadable->second});
  }
  if (sounds.noise)
    for (const std::string& file : sounds.noise->files)
      files.push_back({.group = "noise", .name = file, .path = sounds.noise->root / file});
  return {std::move(files),
          run.out,
          {.skip_bad = config.skip_bad, .sample_rate_hz = sample_rate_hz, .threads = run.threads, .progress = run.opening}};
}

/// Leaves the good files.
void keep_good(SoundFolder& folder, const CorpusInputs& inputs, const std::string& group) {
  folder.files = inputs.good(group);
  if (folder.files.empty()) throw InputError(folder.root.string(), "has no usable sound file", "repair the files, or give another folder");
}

/// Writes the files of a mixture and makes its line of the manifest.
class SignalWriter {
 public:
  SignalWriter(const ConvolveConfig& config, const ResponseIndex& index, const Transcripts& transcripts, CorpusPieceWriter& writer)
      : config_(config), index_(index), transcripts_(transcripts), writer_(writer) {}

  void write(std::uint64_t number, const Mixture& mixture) {
    const auto channels = static_cast<int>(index_.channels().size());
    const std::uint32_t mask = channel_mask_of(index_.channels());
    const std::string id = fmt::format("{:07}", number);
    const auto add = [&](const std::string& suffix, std::span<const float> samples, int width) -> std::string {
      const std::string name = id + suffix + ending_of(config_.format);
      return writer_.write(name, encode_sound(samples, width, index_.sample_rate_hz(), config_.format, name, width == channels ? mask : 0));
    };
    Json line = {{"id", id},
                 {"file", add("", mixture.samples, channels)},
                 {"num_samples", mixture.num_frames},
                 {"level_dbfs", rounded(mixture.level_dbfs)},
                 {"lowered", mixture.lowered}};
    Json talkers = Json::array();
    for (std::size_t t = 0; t < mixture.talkers.size(); ++t) {
      const MixedTalker& talker = mixture.talkers[t];
      const IndexedResponse& response = index_.responses()[talker.response];
      Json labels = {{"speech", talker.speech}, {"start_sample", talker.start_sample}, {"num_samples", talker.dry_samples}};
      labels.update(parse_ordered_json(response.labels));
      labels["gain"] = rounded(talker.gain);
      labels["same_listener"] = response.place == index_.responses()[mixture.talkers[0].response].place;
      const std::string suffix = fmt::format(".t{}", t);
      if (config_.stems) labels["file"] = add(suffix, talker.reverberant, channels);
      if (config_.early) labels["early_file"] = add(suffix + ".early", talker.early, channels);
      if (config_.dry) labels["dry_file"] = add(suffix + ".dry", talker.dry, 1);
      if (const auto text = transcripts_.of(talker.speech)) labels["text"] = *text;
      talkers.push_back(labels);
    }
    line["talkers"] = talkers;
    line["noise"] = nullptr;
    if (mixture.has_noise) {
      const MixedNoise& noise = mixture.noise;
      Json labels = {{"sound", noise.sound}, {"start_sample", noise.start_sample}, {"snr_db", rounded(noise.snr_db)}};
      if (noise.response >= 0) {
        const IndexedResponse& response = index_.responses()[static_cast<std::size_t>(noise.response)];
        labels.update(parse_ordered_json(response.labels));
        labels["same_listener"] = response.place == index_.responses()[mixture.talkers[0].response].place;
      } else {
        labels["response"] = nullptr;
      }
      labels["gain"] = rounded(noise.gain);
      if (config_.stems) labels["file"] = add(".noise", noise.samples, channels);
      line["noise"] = labels;
    }
    writer_.add_line(json_text(line));
  }

 private:
  const ConvolveConfig& config_;
  const ResponseIndex& index_;
  const Transcripts& transcripts_;
  CorpusPieceWriter& writer_;
};

/// The talkers of a recording as lhotse's SupervisionSegments.
std::string supervision_lines(const std::string& manifest_line, float sample_rate_hz, std::size_t num_channels) {
  const Json recording = parse_ordered_json(manifest_line);
  Json channels = Json::array();
  for (std::size_t channel = 0; channel < num_channels; ++channel) channels.push_back(channel);
  const auto frames = recording.at("num_samples").get<std::uint64_t>();
  std::string lines;
  std::size_t number = 0;
  for (const Json& talker : recording.at("talkers")) {
    // From the direct sound on, to the end of the dry sound, which a mixture contains.
    const double rate_hz = static_cast<double>(sample_rate_hz);
    const auto delay = static_cast<std::uint64_t>(std::lround(talker.at("direct_delay_s").get<double>() * rate_hz));
    const std::uint64_t begin = std::min(frames, talker.at("start_sample").get<std::uint64_t>() + delay);
    const std::uint64_t end = std::min(frames, begin + talker.at("num_samples").get<std::uint64_t>());
    Json custom = talker;
    custom.erase("text");
    custom["snr_db"] = recording.at("noise").is_null() ? Json(nullptr) : recording.at("noise").at("snr_db");
    Json segment = {{"id", fmt::format("{}-{}", recording.at("id").get<std::string>(), number++)},
                    {"recording_id", recording.at("id")},
                    {"start", static_cast<double>(begin) / rate_hz},
                    {"duration", static_cast<double>(end - begin) / rate_hz},
                    {"channel", channels}};
    if (talker.contains("text")) segment["text"] = talker.at("text");
    segment["custom"] = custom;
    lines += json_text(segment) + "\n";
  }
  return lines;
}

std::uint64_t count_lowered(const std::filesystem::path& manifest) {
  const std::string text = read_file(manifest);
  std::uint64_t count = 0;
  for (std::size_t at = 0; (at = text.find("\"lowered\":true", at)) != std::string::npos; ++at) ++count;
  return count;
}

}  // namespace

void validate(const ConvolveConfig& config) {
  require(config.count <= 100'000'000, "--count", config.count, "must be in [0, 100000000]; 0: one signal per speech file");
  require(config.min_talkers >= 1 && config.min_talkers <= config.max_talkers && config.max_talkers <= 100, "--talkers",
          fmt::format("{},{}", config.min_talkers, config.max_talkers), "must be LOW,HIGH in [1, 100] with LOW <= HIGH");
  validate_range(config.talker_db, "--talker-level", -60, 60);
  validate_range(config.snr_db, "--snr", -60, 120);
  validate_range(config.level_dbfs, "--level", -100, 0);
  const auto validate_wished = [](const std::vector<float>& wished, const std::string& key, float low, float high) {
    const bool ok = wished.empty() || (wished.size() == 2 && wished[0] >= low && wished[1] <= high && wished[0] < wished[1]);
    require(ok, key, listed(wished, ","), fmt::format("must be LOW,HIGH in [{}, {}] with LOW < HIGH", low, high));
  };
  validate_wished(config.wished.rt60_s, "--rt60", 0, 100);
  validate_wished(config.wished.drr_db, "--drr", -100, 100);
  const int per_folder = config.signals_per_folder;
  require(per_folder >= 1 && per_folder <= 100'000 && (per_folder <= kSignalsPerPart || per_folder % kSignalsPerPart == 0),
          "--signals-per-folder", per_folder, "must be in [1, 10], or a multiple of 10 up to 100000");
}

ConvolveReport write_convolve_corpus(const ConvolveConfig& config, const CorpusRun& run) {
  validate(config);
  validate(run);
  if (config.measured) require_outside(run.out, config.corpus, "CORPUS");
  const ResponseIndex index = config.measured ? ResponseIndex::of_measured(config.corpus) : ResponseIndex(config.corpus);
  std::optional<WishedResponses> wished;
  if (!config.wished.is_empty()) wished.emplace(index, config.wished);
  require_outside(run.out, config.speech, "--speech");
  SoundFolder speech = SoundFolder::list(config.speech);
  std::optional<SoundFolder> noise;
  if (config.noise.starts_with("synth:"))
    (void)synthesize_sound(config.noise, index.sample_rate_hz());  // an unknown kind shows before anything is written
  else if (!config.noise.empty() && config.noise != "synth") {
    require_outside(run.out, config.noise, "--noise");
    noise = SoundFolder::list(config.noise);
  }
  if (config.early && !index.has_early())
    throw InputError("--early", "needs early parts of responses, which " + config.corpus + " does not contain",
                     "write the corpus again with split_ms: 50");
  if (index.fewest_sources() < static_cast<std::size_t>(config.max_talkers))
    throw InputError(fmt::format("--talkers {},{}", config.min_talkers, config.max_talkers),
                     fmt::format("is more than the {} sources in a room of {}", index.fewest_sources(), config.corpus),
                     "use fewer talkers, or write the corpus with a larger sources_per_room");
  if (config.format == SoundFormat::flac && index.channels().size() > 8)
    throw InputError("--format flac", fmt::format("supports at most 8 channels, but the responses have {}", index.channels().size()),
                     "use --format wav");

  // What does not depend on files is compared before they are opened.
  CorpusFolder::refuse_others(
      run.out,
      CorpusFolder::describe("convolve", config_lines(config, index, nullptr, config.count), index.sample_rate_hz(), index.channels()),
      keys_of_files(config));
  Transcripts transcripts(speech);
  ConvolveSounds sounds{.speech = std::move(speech), .noise = std::move(noise), .transcripts = std::move(transcripts)};
  const CorpusInputs inputs = open_inputs(config, run, index.sample_rate_hz(), sounds);
  keep_good(sounds.speech, inputs, "speech");
  if (sounds.noise) keep_good(*sounds.noise, inputs, "noise");

  const std::uint64_t signals = config.count > 0 ? config.count : sounds.speech.files.size();
  const auto per_part = static_cast<std::uint64_t>(std::min(kSignalsPerPart, config.signals_per_folder));
  const std::uint64_t parts_per_folder = static_cast<std::uint64_t>(config.signals_per_folder) / per_part;
  const CorpusFolder folder(run.out, static_cast<std::size_t>((signals + per_part - 1) / per_part),
                            static_cast<std::size_t>(parts_per_folder), index.sample_rate_hz(), index.channels().size());
  folder.begin(CorpusFolder::describe("convolve", config_lines(config, index, &sounds, signals), index.sample_rate_hz(), index.channels()));
  inputs.record();

  const auto end_of = [&](std::size_t part) { return std::min<std::uint64_t>(signals, (part + 1) * per_part); };
  const CorpusPartsReport done = complete_corpus(
      folder, run,
      {.items = [&](std::size_t part) { return end_of(part) - part * per_part; },
       .make_worker =
           [&] {
             auto maker = std::make_shared<MixtureMaker>(config, index, sounds.speech, sounds.noise_folder(), wished ? &*wished : nullptr);
             return [&, maker](CorpusPiece piece, CorpusPieceWriter& writer, const std::function<void()>& count_item) {
               SignalWriter signal_writer(config, index, sounds.transcripts, writer);
               for (std::uint64_t number = piece.part * per_part; number < end_of(piece.part); ++number) {
                 signal_writer.write(number, maker->mix(number));
                 count_item();
               }
             };
           },
       .derived = {{"supervisions.jsonl",
                    [&](const std::string& line) { return supervision_lines(line, index.sample_rate_hz(), index.channels().size()); }}}});
  ConvolveReport report{.signals = done.items,
                        .all_signals = signals,
                        .folders_missing = done.folders_missing,
                        .left_out = inputs.left_out(),
                        .speech_files = sounds.speech.files.size(),
                        .unused_texts = sounds.transcripts.unused_lines()};
  report.without_text = static_cast<std::size_t>(
      std::ranges::count_if(sounds.speech.files, [&](const std::string& file) { return !sounds.transcripts.of(file).has_value(); }));
  if (report.folders_missing == 0) report.lowered = count_lowered(run.out / "manifest.jsonl");
  return report;
}

}  // namespace earshot
