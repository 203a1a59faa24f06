// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/accuracy_modes.h"

#include <fmt/format.h>

#include <functional>

namespace earshot {
namespace {

using Change = std::function<void(AcousticConfig&)>;

AcousticConfig fast_config() {
  AcousticConfig config = acoustic_preset("fast");
  config.threads = 1;
  config.rir_length_s = 0.f;
  return config;
}

const char* method_of(const AcousticConfig& config) {
  if (config.source_rays > 0) return "bidirectional";
  return config.field == Switch::on ? "source field" : config.field == Switch::off ? "path tracer" : "plan's choice";
}

constexpr int kSweepStride = 2, kHighStride = 6;  ///< `high` takes seconds a response

AccuracyMode preset_mode(const char* name) {
  AcousticConfig config = acoustic_preset(name);
  config.threads = 1;
  config.rir_length_s = 0.f;
  return {.sweep = "preset",
          .value = name,
          .method = method_of(config),
          .config = config,
          .is_fast = std::string(name) == "fast",
          .pose_stride = config.source_rays > 0 ? kHighStride : 1};
}

class ModeList {
 public:
  void add(const std::string& sweep, const std::string& value, const Change& change) {
    AcousticConfig config = fast_config();
    change(config);
    modes_.push_back({.sweep = sweep, .value = value, .method = method_of(config), .config = config, .pose_stride = kSweepStride});
  }
  /// A value that the preset has.
  void add_fast(const std::string& sweep, const std::string& value) {
    modes_.push_back({.sweep = sweep, .value = value, .method = method_of(fast_config()), .config = fast_config(), .is_fast = true});
  }
  std::vector<AccuracyMode> modes_;
};

void tracer(AcousticConfig& config) { config.field = Switch::off; }
/// The number of photons is the one set: no error target ends the pass before.
void field_of(AcousticConfig& config, int photons) {
  config.field = Switch::on;
  config.field_photons = photons;
  config.field_error = 1e-4f;
}

}  // namespace

std::vector<AccuracyMode> accuracy_modes(bool quick) {
  ModeList list;
  list.modes_ = {preset_mode("fast"), preset_mode("balanced")};
  if (!quick) list.modes_.push_back(preset_mode("high"));
  for (const int rays : quick ? std::vector<int>{64, 512} : std::vector<int>{16, 64, 256, 1024})
    list.add("rays", std::to_string(rays), [rays](AcousticConfig& c) { tracer(c), c.rays = rays; });
  for (const int photons : quick ? std::vector<int>{1024, 8192} : std::vector<int>{1024, 4096, 16384})
    list.add("photons", std::to_string(photons), [photons](AcousticConfig& c) { field_of(c, photons); });
  if (quick) return list.modes_;

  const auto cells = [&](float cell_m) {
    list.add("cell size", fmt::format("{:g} m", cell_m), [cell_m](AcousticConfig& c) { c.field = Switch::on, c.field_cell_m = cell_m; });
  };
  cells(0.5f);
  list.add_fast("cell size", "1 m");
  cells(2.f);
  for (const int bounces : {8, 32, 128})
    list.add("bounces", std::to_string(bounces), [bounces](AcousticConfig& c) { tracer(c), c.rays = 256, c.max_bounces = bounces; });
  for (const int bands : {4, 0, 14}) {
    if (bands == 0) {
      list.add_fast("bands", "octaves");
    } else {
      list.add("bands", std::to_string(bands), [bands](AcousticConfig& c) { c.bands = bands; });
    }
  }
  // Two ears use no more than first order.
  list.add("SH order", "0", [](AcousticConfig& c) { c.sh_order = 0; });
  list.add_fast("SH order", "1");
  list.add("late decoding", "0 s", [](AcousticConfig& c) { c.late_decode_s = 0; });
  list.add_fast("late decoding", "0.16 s");
  list.add("late decoding", "all", [](AcousticConfig& c) { c.late_decode_s = 60; });
  for (const float length_s : {0.5f, 1.f})
    list.add("RIR length", fmt::format("{:g} s", length_s), [length_s](AcousticConfig& c) { c.rir_length_s = length_s; });
  list.add_fast("RIR length", "auto");
  list.add_fast("effects", "all auto");
  list.add("effects", "no early", [](AcousticConfig& c) { c.early = Switch::off; });
  list.add("effects", "no diffraction", [](AcousticConfig& c) { c.diffraction = Switch::off; });
  list.add("effects", "diffraction on", [](AcousticConfig& c) { c.diffraction = Switch::on; });
  list.add("effects", "no transmission", [](AcousticConfig& c) { c.transmission = Switch::off; });
  list.add("effects", "no air", [](AcousticConfig& c) { c.air_absorption = Switch::off; });
  return list.modes_;
}

}  // namespace earshot
