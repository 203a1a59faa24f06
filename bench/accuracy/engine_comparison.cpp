// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/engine_comparison.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "bench/measure/bench_scene.h"
#include "bench/measure/plot_svg.h"
#include "sim/acoustics/source_field/source_field.h"
#include "sim/acoustics/synthesis/carriers.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "sim/base/stopwatch.h"
#include "sim/base/temporary_folder.h"
#include "sim/scene/generators/shoebox.h"

namespace earshot {
namespace {

constexpr double kSampleRateHz = 16'000;

/// Ours: one way to render.
struct OwnSetting {
  std::string engine, setting;
  AcousticConfig config;
};

AcousticConfig own_config(const ShoeboxRoom& room) {
  AcousticConfig config = acoustic_preset("fast");
  config.threads = 1;
  config.rir_length_s = static_cast<float>(room.length_s);
  config.scattering = 0;
  config.air_absorption = Switch::off;
  return config;
}

std::vector<OwnSetting> own_settings(const ShoeboxRoom& room, bool quick) {
  std::vector<OwnSetting> settings;
  for (const int photons : quick ? std::vector<int>{1024} : std::vector<int>{512, 2048, 8192, 32768}) {
    AcousticConfig config = own_config(room);
    config.field = Switch::on;
    config.field_photons = photons;
    config.field_error = 1e-4f;  // the number of photons is the one set
    settings.push_back({"earshot, source field", fmt::format("{} photons", photons), config});
  }
  for (const int rays : quick ? std::vector<int>{64} : std::vector<int>{16, 64, 256, 1024}) {
    AcousticConfig config = own_config(room);
    config.field = Switch::off;
    config.rays = rays;
    settings.push_back({"earshot, path tracer", fmt::format("{} rays", rays), config});
  }
  for (const int rays : quick ? std::vector<int>{} : std::vector<int>{256, 1024, 4096}) {
    AcousticConfig config = acoustic_preset("high");
    const AcousticConfig room_config = own_config(room);
    config.threads = room_config.threads;
    config.rir_length_s = room_config.rir_length_s;
    config.scattering = room_config.scattering;
    config.air_absorption = room_config.air_absorption;
    config.rays = rays;
    config.source_rays = rays / 4;
    settings.push_back({"earshot, both ends", fmt::format("{} rays, images 4", rays), config});
  }
  return settings;
}

/// Constant within each octave, so that the mean over a band is its value.
Material mirror(const std::string& name, double sample_rate_hz, const std::vector<double>& absorption) {
  constexpr float inside = 1e-4f;
  const BandLayout bands = BandLayout::octaves(static_cast<float>(sample_rate_hz));
  Material material = Material::uniform(name, 0, 0);
  material.absorption = {};
  for (std::size_t b = 0; b < absorption.size(); ++b)
    for (const float hz : {(1 + inside) * bands.edge_hz[b], (1 - inside) * bands.edge_hz[b + 1]}) {
      material.absorption.hz.push_back(hz);
      material.absorption.value.push_back(static_cast<float>(absorption[b]));
    }
  return material;
}

}  // namespace

std::shared_ptr<const Scene> mirror_box(const ShoeboxRoom& room) {
  std::vector<Material> materials;
  for (std::size_t wall = 0; wall < room.absorption.size(); ++wall)
    materials.push_back(mirror(fmt::format("wall {}", wall), room.sample_rate_hz, room.absorption[wall]));
  Air air;
  air.speed_of_sound_m_per_s = static_cast<float>(room.speed_of_sound_m_per_s);
  return std::make_shared<const Scene>("comparison", make_shoebox(glm::vec3(room.size_m)), std::move(materials), air);
}

namespace {

RoomMetrics heard(const ShoeboxRoom& room, std::size_t listener, std::span<const float> samples) {
  const glm::dvec3 to = room.listeners_m[listener] - room.source_m;
  const double delay_s = std::sqrt(to.x * to.x + to.y * to.y + to.z * to.z) / room.speed_of_sound_m_per_s;
  return measure(samples, static_cast<float>(room.sample_rate_hz), delay_s);
}

std::vector<std::vector<RoomMetrics>> exact_metrics(const std::vector<ShoeboxRoom>& rooms) {
  std::vector<std::vector<RoomMetrics>> exact;
  for (const ShoeboxRoom& room : rooms) {
    exact.emplace_back();
    for (std::size_t l = 0; l < room.listeners_m.size(); ++l) exact.back().push_back(measure_images(room, l));
  }
  return exact;
}

std::vector<std::vector<RoomMetrics>> pressure_metrics(const std::vector<ShoeboxRoom>& rooms) {
  std::vector<std::vector<RoomMetrics>> rendered;
  for (const ShoeboxRoom& room : rooms) {
    rendered.emplace_back();
    for (std::size_t l = 0; l < room.listeners_m.size(); ++l) rendered.back().push_back(heard(room, l, render_images(room, l)));
  }
  return rendered;
}

/// Against both truths.
EnginePoint compare_repeated_runs(const EngineComparison& comparison, const std::vector<std::vector<RoomMetrics>>& rendered) {
  EnginePoint point = judge_responses(comparison.energies, rendered);
  const EnginePoint pressure = judge_responses(comparison.pressures, rendered);
  point.pressure_t20 = pressure.t20_all;
  point.pressure_c50_db = pressure.c50_db;
  point.pressure_drr_db = pressure.drr_db;
  return point;
}

/// All listeners of one room twice, the second time timed: seconds per response, with everything that one source and these listeners
/// take after the scene is prepared.
double render_own(const ShoeboxRoom& room, const AcousticConfig& config, std::vector<RoomMetrics>& metrics) {
  const AcousticScene acoustics(mirror_box(room), config);
  if (uses_source_field(acoustics)) static_cast<void>(acoustics.field_grid());
  RirSynthesizer synthesizer(make_synthesis_tables(acoustics.config(), acoustics.bands(), ListenerLayout(ChannelLayout::mono), nullptr));
  std::vector<Rir> rirs(room.listeners_m.size());
  double seconds = 0;
  for (int pass = 0; pass < 2; ++pass) {
    const Stopwatch watch;
    EnergyResponse response;
    const EarlyCandidates candidates(acoustics, glm::vec3(room.source_m));
    const auto field = uses_source_field(acoustics) ? build_source_field(acoustics, candidates) : nullptr;
    for (std::size_t l = 0; l < rirs.size(); ++l) {
      compute_energy_response(acoustics, candidates, field.get(), glm::vec3(room.listeners_m[l]), response);
      synthesizer.render(response, 0.0, carrier_key(acoustics.scene().hash()), rirs[l]);
    }
    seconds = watch.wall_s() / static_cast<double>(rirs.size());
  }
  for (std::size_t l = 0; l < rirs.size(); ++l) metrics.push_back(heard(room, l, rirs[l].channel(0)));
  return seconds;
}

/// One engine at one time allowed in all rooms; false, and a line in `left_out`, if it is not available.
bool ask_in_rooms(const EngineCommand& engine, double allowed_s, EngineComparison& comparison) {
  const TemporaryFolder folder(std::filesystem::temp_directory_path(), "earshot_engine_");
  std::vector<std::vector<RoomMetrics>> rendered;
  std::string setting;
  double seconds = 0;
  for (const ShoeboxRoom& room : comparison.rooms) {
    const EngineAnswer answer = ask_engine(engine, room, allowed_s, folder.path());
    if (!answer.available) {
      comparison.left_out.push_back(engine.name + " is left out: " + answer.note);
      return false;
    }
    seconds += answer.seconds_per_response / static_cast<double>(comparison.rooms.size());
    if (setting.find(answer.setting) == std::string::npos) setting += (setting.empty() ? "" : "; ") + answer.setting;
    rendered.emplace_back();
    for (std::size_t l = 0; l < answer.responses.size(); ++l) rendered.back().push_back(heard(room, l, answer.responses[l]));
  }
  EnginePoint point = compare_repeated_runs(comparison, rendered);
  point.engine = engine.name;
  point.setting = setting;
  point.allowed_ms = 1e3 * allowed_s;
  point.ms = 1e3 * seconds;
  comparison.points.push_back(std::move(point));
  return true;
}

}  // namespace

std::vector<ShoeboxRoom> comparison_rooms(bool quick) {
  const std::vector<float> bands_hz = BandLayout::octaves(static_cast<float>(kSampleRateHz)).centre_hz;
  // Fractions of the energy at 125 Hz ... 8 kHz: hard, panelled and soft walls.
  const std::vector<double> plaster{0.08, 0.08, 0.07, 0.06, 0.06, 0.06, 0.06}, panel{0.28, 0.22, 0.17, 0.11, 0.10, 0.10, 0.10},
      carpet{0.05, 0.08, 0.16, 0.28, 0.35, 0.40, 0.42}, ceiling{0.20, 0.30, 0.45, 0.50, 0.48, 0.45, 0.42};
  std::vector<ShoeboxRoom> rooms;
  const auto add = [&](glm::dvec3 size_m, std::array<std::vector<double>, 6> absorption, glm::dvec3 source_m,
                       std::vector<glm::dvec3> listeners_m, double length_s) {
    rooms.push_back({.size_m = size_m,
                     .bands_hz = bands_hz,
                     .absorption = std::move(absorption),
                     .source_m = source_m,
                     .listeners_m = std::move(listeners_m),
                     .sample_rate_hz = kSampleRateHz,
                     .length_s = length_s});
  };
  // No listener is so near to a wall that a reflection falls into the 2.5 ms which count as direct sound.
  add({5.1, 3.05, 4.2}, {plaster, panel, carpet, ceiling, plaster, plaster}, {1.3, 1.45, 1.2},
      {{3.6, 1.4, 2.9}, {2.9, 1.6, 1.4}, {3.9, 1.5, 1.6}, {2.3, 1.3, 2.8}}, 1.2);
  if (quick) return rooms;
  add({8.3, 3.3, 6.1}, {plaster, plaster, plaster, panel, panel, plaster}, {2.1, 1.5, 1.9},
      {{6.3, 1.6, 4.2}, {4.4, 1.4, 1.7}, {3.1, 1.7, 4.3}, {6.7, 1.6, 1.8}}, 2.0);
  add({13.7, 4.6, 9.2}, {panel, panel, carpet, plaster, plaster, panel}, {3.0, 1.7, 3.3},
      {{9.8, 1.6, 6.2}, {6.3, 1.9, 2.6}, {10.9, 2.2, 3.1}, {5.1, 1.7, 6.6}}, 2.0);
  return rooms;
}

std::vector<EngineCommand> usual_engines() {
  const std::optional<std::string> script = source_file("scripts/engines/pyroomacoustics_engine.py");
  if (!script) return {};
  std::vector<EngineCommand> engines;
  for (const char* method : {"hybrid", "images"})
    engines.push_back({.name = fmt::format("pyroomacoustics, {}", method),
                       .command = fmt::format("python3 {} --method {}", shell_quoted(*script), method),
                       .optional = true});
  return engines;
}

EnginePoint judge_responses(const std::vector<std::vector<RoomMetrics>>& exact, const std::vector<std::vector<RoomMetrics>>& rendered) {
  // The exact response is both halves of its truth, the rendered one both draws: one room and listener is one pose.
  std::vector<TruthValues> truth;
  std::vector<DrawnValues> test;
  for (std::size_t r = 0; r < exact.size(); ++r)
    for (std::size_t l = 0; l < exact[r].size(); ++l) {
      HeardResponse of_truth, of_test;
      of_truth.energy = exact[r][l];
      of_test.energy = rendered[r][l];
      const ResponseValues values = truth_values(of_truth), drawn = test_values(of_test, of_truth);
      truth.push_back({values, values, values});
      test.push_back({drawn, drawn});
    }
  EnginePoint point;
  const std::size_t bands = exact.empty() || exact[0].empty() ? 0 : exact[0][0].bands.size();
  for (std::size_t band = 0; band < bands; ++band) point.t20.push_back(summarise(truth, test, ErrorKind::t20, static_cast<int>(band)));
  point.t20_all = summarise(truth, test, ErrorKind::t20);
  point.c50_db = summarise(truth, test, ErrorKind::c50_db);
  point.drr_db = summarise(truth, test, ErrorKind::drr_db);
  return point;
}

EngineComparison compare_engines(const std::vector<EngineCommand>& engines, bool quick,
                                 const std::function<void(const std::string& stage)>& progress) {
  EngineComparison comparison;
  comparison.rooms = comparison_rooms(quick);
  comparison.energies = exact_metrics(comparison.rooms);
  comparison.pressures = pressure_metrics(comparison.rooms);
  EnginePoint& of_pressure = comparison.points.emplace_back(compare_repeated_runs(comparison, comparison.pressures));
  of_pressure.engine = "exact pressure of all images";
  of_pressure.setting = "what interference alone makes";
  of_pressure.ms = std::nan("");
  // Others before ours: one that breaks the protocol is refused before minutes are spent.
  for (const EngineCommand& engine : engines)
    for (const double allowed_s : quick ? std::vector<double>{0.03} : std::vector<double>{1, 0.3, 0.1, 0.03, 0.01}) {
      if (!ask_in_rooms(engine, allowed_s, comparison)) break;
      if (progress) progress(fmt::format("{}, {:g} ms", engine.name, 1e3 * allowed_s));
      if (comparison.points.back().ms > 1e3 * allowed_s) break;  // more than it was given: less time would hardly give less
    }
  const std::size_t settings = own_settings(comparison.rooms.front(), quick).size();
  for (std::size_t s = 0; s < settings; ++s) {
    std::vector<std::vector<RoomMetrics>> rendered;
    double seconds = 0;
    OwnSetting setting;
    for (const ShoeboxRoom& room : comparison.rooms) {
      setting = own_settings(room, quick)[s];
      seconds += render_own(room, setting.config, rendered.emplace_back()) / static_cast<double>(comparison.rooms.size());
    }
    EnginePoint point = compare_repeated_runs(comparison, rendered);
    point.engine = setting.engine;
    point.setting = setting.setting;
    point.ms = 1e3 * seconds;
    comparison.points.push_back(std::move(point));
    if (progress) progress(setting.engine + ", " + setting.setting);
  }
  return comparison;
}

}  // namespace earshot
