// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apps/commands.h"
#include "apps/options/output_options.h"
#include "apps/options/parameter_options.h"
#include "apps/sound/rir_json.h"
#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"

namespace earshot {
namespace {

struct MeasureArguments {
  std::string file, metrics, bands = "octaves", lateral, reference;
  std::optional<int> channel, lateral_channel;
  std::optional<double> direct_delay_s, distance_m;
  ParameterOptions parameters;
  bool is_green = false, without_noise = false;
};

std::span<const float> channel_of(const SoundChannels& sound, int channel, const std::string& option, const std::string& file) {
  if (channel < 0 || channel >= sound.num_channels)
    throw InputError(option, fmt::format("is {} for {}, which has {} channels", channel, file, sound.num_channels),
                     "count channels from 0");
  return sound.channel(channel);
}

/// A file that goes with the measured one.
SoundChannels load_beside(const std::string& file, const std::string& option, float sample_rate_hz) {
  SoundChannels sound = load_sound_channels(file);
  if (sound.sample_rate_hz != sample_rate_hz)
    throw InputError(option + " " + file,
                     fmt::format("has a rate of {:.0f} Hz, the response has {:.0f} Hz", sound.sample_rate_hz, sample_rate_hz),
                     "resample one of them");
  return sound;
}

RirMeasurement reading_of(const MeasureArguments& options) {
  RirMeasurement how;
  how.request = options.parameters.request();
  if (how.request.interaural)
    throw InputError("--parameters", "'interaural' asks for standard errors, which a single response does not have",
                     "leave it out: IACC of two channels is always measured");
  how.direct_delay_s = options.direct_delay_s;
  if (options.bands == "third_octaves")
    how.bands = MeasuredBands::third_octaves;
  else if (options.bands == "octaves")
    how.low_octave = true;
  else
    throw InputError("--bands", "'" + options.bands + "' is not a kind of bands", "use octaves or third_octaves");
  how.is_green = options.is_green;
  how.without_noise = options.without_noise;
  how.distance_m = options.distance_m;
  return how;
}

OrderedJson channel_json(const RoomMetrics& metrics, int channel, const ParameterRequest& request) {
  OrderedJson json{{"channel", channel},
                   {"direct_delay_s", number_or_null(metrics.direct_delay_s)},
                   {"direct_amplitude", number_or_null(metrics.direct_amplitude)}};
  json.update(metrics_json(metrics, request));
  for (const char* key : {"iacc", "iacc_early", "iacc_late"}) json.erase(key);
  return json;
}

void print(const RoomMetrics& metrics, int channel) {
  const auto text = [](const std::optional<double>& value, const char* unit) {
    return value ? fmt::format("{:.3g} {}", *value, unit) : std::string("-");
  };
  fmt::print("channel {}: direct sound at {}, DRR {}{}\n", channel, text(metrics.direct_delay_s, "s"), text(metrics.drr_db, "dB"),
             metrics.sti ? fmt::format(", STI {:.3f}", *metrics.sti) : "");
  for (std::size_t b = 0; b < metrics.bands.size(); ++b)
    fmt::print("  {:>6.0f} Hz  EDT {}  T20 {}  C80 {}  DRR {}\n", metrics.bands_hz[b], text(metrics.bands[b].edt_s, "s"),
               text(metrics.bands[b].t20_s, "s"), text(metrics.bands[b].c80_db, "dB"), text(metrics.bands[b].drr_db, "dB"));
  for (const MissingParameter& missing : metrics.missing) fmt::print("  {}: {}\n", missing.key, missing.reason);
}

/// Adds the correlation of two channels.
void add_interaural(const SoundChannels& sound, const RirMeasurement& how, OrderedJson& json) {
  const Rir ears{.num_channels = 2,
                 .num_samples = static_cast<int>(sound.num_frames()),
                 .sample_rate_hz = sound.sample_rate_hz,
                 .samples = sound.samples};
  RoomMetrics correlations;
  correlations.bands = measure_interaural(ears, how);
  const OrderedJson metrics = metrics_json(correlations);
  for (const char* key : {"iacc", "iacc_early", "iacc_late"}) json[key] = metrics.at(key);
}

/// Files beside the measured one; the spans of a measurement point into them.
struct SoundsBeside {
  std::optional<SoundChannels> lateral, reference;
};

/// The one channel of a file, or the one that was named.
std::span<const float> lateral_of(const MeasureArguments& options, const SoundChannels& sound, const SoundsBeside& beside) {
  if (beside.lateral) {
    if (!options.lateral_channel && beside.lateral->num_channels > 1)
      throw InputError("--lateral " + options.lateral, fmt::format("has {} channels", beside.lateral->num_channels),
                       "name that of the figure-of-eight microphone with --lateral-channel");
    return channel_of(*beside.lateral, options.lateral_channel.value_or(0), "--lateral-channel", options.lateral);
  }
  if (!options.lateral_channel) return {};
  if (*options.lateral_channel == options.channel.value_or(0))
    throw InputError("--lateral-channel", fmt::format("is {}, the channel that is measured", *options.lateral_channel),
                     "name the channel of the figure-of-eight microphone, and the measured one with --channel");
  return channel_of(sound, *options.lateral_channel, "--lateral-channel", options.file);
}

std::span<const float> reference_of(const MeasureArguments& options, const SoundsBeside& beside) {
  if (!beside.reference) return {};
  if (beside.reference->num_channels > 1)
    throw InputError("--reference " + options.reference, fmt::format("has {} channels", beside.reference->num_channels),
                     "give a file with the channel of the measured microphone alone");
  return beside.reference->channel(0);
}

void run_measure(const MeasureArguments& options) {
  RirMeasurement how = reading_of(options);
  const SoundChannels sound = load_sound_channels(options.file);
  SoundsBeside beside;
  if (!options.lateral.empty()) beside.lateral = load_beside(options.lateral, "--lateral", sound.sample_rate_hz);
  if (!options.reference.empty()) beside.reference = load_beside(options.reference, "--reference", sound.sample_rate_hz);
  how.lateral = lateral_of(options, sound, beside);
  how.reference_10m = reference_of(options, beside);

  int first = 0, last = sound.num_channels - 1;
  if (options.channel) {
    (void)channel_of(sound, *options.channel, "--channel", options.file);
    first = last = *options.channel;
  } else if (!how.lateral.empty()) {
    last = 0;  // the figure-of-eight response goes with one microphone
  }
  const MeasurementNames names{.rir = options.file.c_str(),
                               .direct_delay = "--direct-delay",
                               .distance = "--distance",
                               .lateral = options.lateral.empty() ? "--lateral-channel" : "--lateral",
                               .reference = "--reference",
                               .green = "--green",
                               .parameters = "--parameters"};
  for (int channel = first; channel <= last; ++channel)
    check_measurement(sound.channel(channel), static_cast<double>(sound.sample_rate_hz), how, names);
  fmt::print("{}: {} channels, {} samples at {:.0f} Hz\n", options.file, sound.num_channels, sound.num_frames(), sound.sample_rate_hz);
  OrderedJson report{{"schema_version", 1}, {"sample_rate_hz", sound.sample_rate_hz}};
  OrderedJson channels = OrderedJson::array();
  for (int channel = first; channel <= last; ++channel) {
    const RoomMetrics metrics = measure(sound.channel(channel), sound.sample_rate_hz, how);
    report["bands_hz"] = metrics.bands_hz;
    print(metrics, channel);
    channels.push_back(channel_json(metrics, channel, how.request));
  }
  report["channels"] = channels;
  if (sound.num_channels == 2 && last > first) add_interaural(sound, how, report);
  if (!options.metrics.empty()) write_file_atomically(options.metrics, json_text(report, 1) + "\n");
}

}  // namespace

void add_measure(CLI::App& app) {
  auto options = std::make_shared<MeasureArguments>();
  CLI::App* command = app.add_subcommand("measure", "Measure room-acoustic parameters of a recorded or rendered impulse response");
  command->add_option("file", options->file, "Sound file with an impulse response; each channel is measured")
      ->type_name("FILE")
      ->required();
  command->add_option("--metrics", options->metrics, "JSON file to write, with room-acoustic parameters per band and channel")
      ->type_name(kOutputFile);
  command->add_option("--bands", options->bands, "Bands: octaves or third_octaves")->capture_default_str();
  command->add_option("--channel", options->channel,
                      "Measure this channel alone, counted from 0 (default: all; with a lateral response 0)");
  command->add_option(
      "--direct-delay", options->direct_delay_s,
      "Time of the direct sound in seconds (default: the first sample within 20 dB of the strongest that stands 14 dB above "
      "the quietest 10 ms, the noise)");
  options->parameters.add_to(
      *command, "Further parameters: lateral (J_LF, J_LFC, LG), stage (ST_early, ST_late, of a microphone at 1 m), speech (MTI, STI)");
  command
      ->add_option("--lateral", options->lateral,
                   "Sound file with the response of a figure-of-eight microphone, its null toward the source (for lateral)")
      ->type_name("FILE");
  command->add_option("--lateral-channel", options->lateral_channel,
                      "Channel of the figure-of-eight microphone, in the file of --lateral or else in the measured file");
  command
      ->add_option("--reference", options->reference,
                   "Sound file with the response of the same source and microphone at 10 m in a free field, one channel (for G and LG)")
      ->type_name("FILE");
  command->add_flag("--green", options->is_green, "The samples are in Green units, as 'earshot rir' writes them (for G and LG)");
  command->add_flag("--without-noise", options->without_noise,
                    "Put the decay of each band in the place of the noise at the end of the record, for decay times, clarity and levels");
  command->add_option("--distance", options->distance_m, "Distance of the source in metres (for stage; default: 1)");
  command->callback([options] { run_measure(*options); });
}

}  // namespace earshot
