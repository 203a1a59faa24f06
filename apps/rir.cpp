#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>

#include "apps/acoustic_options.h"
#include "apps/commands.h"
#include "sim/acoustics/room_metrics.h"
#include "sim/audio/sound_clip.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

using Json = nlohmann::ordered_json;

struct Options {
  AcousticOptions acoustics;
  std::string source, listener, out, metrics;
  double heading_deg = 0;
  bool components = false;
};

Json number(const std::optional<double>& value) { return value && std::isfinite(*value) ? Json(*value) : Json(nullptr); }

Json to_json(const RoomMetrics& metrics) {
  struct Entry {
    const char* key;
    std::optional<double> BandMetrics::*value;
  };
  static constexpr std::array<Entry, 10> entries{{{"edt_s", &BandMetrics::edt_s},
                                                  {"t20_s", &BandMetrics::t20_s},
                                                  {"t30_s", &BandMetrics::t30_s},
                                                  {"rt60_s", &BandMetrics::rt60_s},
                                                  {"c50_db", &BandMetrics::c50_db},
                                                  {"c80_db", &BandMetrics::c80_db},
                                                  {"d50", &BandMetrics::d50},
                                                  {"ts_s", &BandMetrics::ts_s},
                                                  {"g_db", &BandMetrics::g_db},
                                                  {"drr_band_db", &BandMetrics::drr_db}}};
  Json json = Json::object();
  for (const auto& entry : entries) {
    Json values = Json::array();
    for (const auto& band : metrics.bands) values.push_back(number(band.*entry.value));
    json[entry.key] = values;
  }
  json["drr_db"] = number(metrics.drr_db);
  return json;
}

/// Standard errors of the energy response by repetition: 8 traces with an eighth of the rays and seeds of their own; the spread of
/// their mean is that of one trace with all rays.
Json standard_errors(const std::shared_ptr<const Scene>& scene, const AcousticConfig& config, glm::vec3 source, glm::vec3 listener) {
  constexpr int batches = 8;
  if (config.rays < batches) return Json::object();
  std::vector<std::vector<double>> rt60, level_db;
  AcousticConfig part = config;
  part.rays = config.rays / batches;
  for (int batch = 0; batch < batches; ++batch) {
    part.seed = config.seed + 0x9E3779B97F4A7C15ull * static_cast<std::uint64_t>(batch + 1);
    const AcousticScene acoustics(scene, part);
    EnergyResponse response;
    compute_energy_response(acoustics, EarlyCandidates(acoustics, source), listener, response);
    const RoomMetrics metrics = measure(acoustics, response);
    rt60.resize(metrics.bands.size());
    level_db.resize(metrics.bands.size());
    for (std::size_t b = 0; b < metrics.bands.size(); ++b) {
      if (metrics.bands[b].rt60_s) rt60[b].push_back(*metrics.bands[b].rt60_s);
      if (metrics.bands[b].g_db) level_db[b].push_back(*metrics.bands[b].g_db);
    }
  }
  const auto errors = [](const std::vector<std::vector<double>>& bands) {
    Json array = Json::array();
    for (const auto& values : bands) {
      if (values.size() < 2) {
        array.push_back(nullptr);
        continue;
      }
      const double n = static_cast<double>(values.size());
      double mean = 0, square = 0;
      for (const double value : values) mean += value / n;
      for (const double value : values) square += (value - mean) * (value - mean);
      array.push_back(std::sqrt(square / (n - 1) / n));
    }
    return array;
  };
  return {{"rt60_s", errors(rt60)}, {"g_db", errors(level_db)}};
}

void run_rir(const Options& options) {
  const AcousticConfig config = options.acoustics.config();
  const glm::vec3 source = parse_point(options.source, "--source"), listener = parse_point(options.listener, "--listener");
  const AcousticScene acoustics = options.acoustics.load(config);
  RirSynthesizer synthesizer(options.acoustics.tables(acoustics));
  const double heading_rad = options.heading_deg * std::numbers::pi / 180;

  const auto begin = std::chrono::steady_clock::now();
  EnergyResponse response;
  compute_energy_response(acoustics, EarlyCandidates(acoustics, source), listener, response);
  Rir rir;
  const std::uint64_t carrier_key = acoustics.hash();
  synthesizer.render(response, heading_rad, carrier_key, rir);
  const double render_ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
  write_wav(options.out, rir.samples, rir.num_channels, rir.sample_rate_hz);

  if (options.components) {
    const auto write_part = [&](const char* name, int least_order, int most_order, bool late) {
      EnergyResponse part;
      part.speed_of_sound_m_per_s = response.speed_of_sound_m_per_s;
      for (const auto& arrival : response.arrivals)
        if (arrival.order >= least_order && arrival.order <= most_order) part.arrivals.push_back(arrival);
      part.late = late ? response.late : make_histogram(acoustics);
      Rir rendered;
      synthesizer.render(part, heading_rad, carrier_key, rendered);
      std::filesystem::path path = options.out;
      path.replace_extension(fmt::format(".{}{}", name, path.extension().string()));
      write_wav(path, rendered.samples, rendered.num_channels, rendered.sample_rate_hz);
    };
    write_part("direct", 0, 0, false);
    write_part("early", 1, 1000, false);
    write_part("late", 1, 0, true);
  }

  const RoomMetrics energy = measure(acoustics, response);
  fmt::print("{}: {} channels, {} samples at {:.0f} Hz, {} arrivals, ray efficiency {:.3f}, {:.1f} ms\n", options.out, rir.num_channels, rir.num_samples, rir.sample_rate_hz,
             response.arrivals.size(), response.stats.ray_efficiency(), render_ms);
  for (std::size_t b = 0; b < energy.bands.size(); ++b)
    fmt::print("  {:>6.0f} Hz  RT60 {}  DRR {}\n", energy.bands_hz[b], energy.bands[b].rt60_s ? fmt::format("{:.3f} s", *energy.bands[b].rt60_s) : "-",
               energy.bands[b].drr_db ? fmt::format("{:.2f} dB", *energy.bands[b].drr_db) : "-");
  if (options.metrics.empty()) return;

  const double delay_s = energy.direct_delay_s ? *energy.direct_delay_s : 0.0;
  const Json json = {{"bands_hz", energy.bands_hz},
                     {"energy", to_json(energy)},
                     {"rir", to_json(measure(rir.channel(0), rir.sample_rate_hz, delay_s))},
                     {"drr_db", number(energy.drr_db)},
                     {"direct_delay_s", number(energy.direct_delay_s)},
                     {"direct_amplitude", number(energy.direct_amplitude)},
                     {"ray_efficiency", response.stats.ray_efficiency()},
                     {"standard_error", standard_errors(acoustics.shared_scene(), config, source, listener)},
                     {"render_ms", render_ms},
                     {"effects", {{"diffraction", "off"}, {"transmission", "off"}}},
                     {"seed", config.seed}};
  write_file_atomically(options.metrics, json.dump(1) + "\n");
}

}  // namespace

void add_rir(CLI::App& app) {
  auto options = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand("rir", "Room impulse response between two points of a scene");
  options->acoustics.add_to(*command, "balanced");
  command->add_option("--source", options->source, "X,Y,Z in metres")->required();
  command->add_option("--listener", options->listener, "X,Y,Z in metres, between the ears")->required();
  command->add_option("--heading", options->heading_deg, "Degrees counter-clockwise from -z, seen from above")->capture_default_str();
  command->add_option("--out", options->out, "WAV file to write (32-bit float; a unit source gives 1 / (4 pi r))")->required();
  command->add_option("--metrics", options->metrics, "JSON file with room-acoustic parameters per band");
  command->add_flag("--components", options->components, "Also write OUT.direct.wav, OUT.early.wav and OUT.late.wav, which add up to the whole");
  command->callback([options] { run_rir(*options); });
}

}  // namespace earshot
