#include "sim/acoustics/core/acoustic_config.h"

#include <cmath>
#include <limits>

#include "sim/acoustics/core/bands.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

const std::map<std::string, Switch> kSwitches = {{"auto", Switch::automatic}, {"on", Switch::on}, {"off", Switch::off}};

bool in_range(float value, float lowest, float highest) { return value >= lowest && value <= highest; }  // false for NaN

}  // namespace

AcousticConfig acoustic_preset(std::string_view name) {
  AcousticConfig config;
  if (name == "fast") return config;
  if (name == "balanced") {
    config.early_order = 3;
    config.early_candidate_rays = 10'000;
    config.rays = 1024;
    config.time_bin_s = 0.002f;
    config.rir_length_s = 1.f;
    config.field_error = 0.015f;
    config.field_cell_m = 0.7f;
    config.late_decode_s = 0.32f;
    config.glide_paths = 6;
    return config;
  }
  if (name == "high") {
    config.field_photons = 1 << 20;
    config.field_error = 0.008f;
    config.field_cell_m = 0.5f;
    config.late_decode_s = 60.f;
    config.glide_paths = 16;
    config.early_order = 4;
    config.diffraction_reflections = 1;
    config.early_candidate_rays = 50'000;
    // As many paths from the source as from the listener, kept for 60 events: at equal time the T30 error two rooms away in house:1 is a
    // third (scattering 0.3) to 0.85 (scattering 1) of that of listener rays alone; fewer events leave more paths to the source volume.
    // Four listener rays for a path of the source: paths with a mirror at both ends, more than nine tenths of the variance in a hall of
    // 14,000 m3, come from listener rays alone.  A quarter of their vertices is connected: 1.36 s there against 2.28 s for all and 0.81 s
    // for 16,384 listener rays, with a scatter over seeds of 1.7 % of EDT and 0.07 dB of C80; twice that with 16,384.
    config.rays = 65'536;
    config.source_rays = 16'384;
    config.source_bounces = 60;
    config.max_bounces = 10'000;
    config.time_bin_s = 0.001f;
    config.rir_length_s = 2.f;
    config.diffuse_last_segment = false;
    config.threads = 0;
    return config;
  }
  throw InputError("preset '" + std::string(name) + "'", "is not a quality preset", "use fast, balanced or high");
}

void read(ConfigReader& reader, AcousticConfig& config) {
  reader.read_choice("direct", config.direct, kSwitches);
  reader.read_choice("early", config.early, kSwitches);
  reader.read_choice("late", config.late, kSwitches);
  reader.read_choice("diffraction", config.diffraction, kSwitches);
  reader.read_choice("transmission", config.transmission, kSwitches);
  reader.read_choice("air_absorption", config.air_absorption, kSwitches);
  reader.read("early_order", config.early_order);
  reader.read("early_candidate_rays", config.early_candidate_rays);
  reader.read("diffraction_order", config.diffraction_order);
  reader.read("diffraction_edge_m", config.diffraction_edge_m);
  reader.read("diffraction_paths", config.diffraction_paths);
  reader.read("diffraction_reflections", config.diffraction_reflections);
  reader.read("transmission_walls", config.transmission_walls);
  reader.read("rays", config.rays);
  reader.read("source_rays", config.source_rays);
  reader.read("source_bounces", config.source_bounces);
  reader.read("specular_exponent", config.specular_exponent);
  reader.read("max_bounces", config.max_bounces);
  reader.read("time_bin_s", config.time_bin_s);
  reader.read("sh_order", config.sh_order);
  std::string length;
  reader.read("rir_length_s", length);
  if (length == "auto")
    config.rir_length_s = 0.f;
  else
    reader.read("rir_length_s", config.rir_length_s);
  std::string radius;
  reader.read("source_radius_m", radius);
  if (radius == "auto")
    config.source_radius_m = 0.f;
  else
    reader.read("source_radius_m", config.source_radius_m);
  reader.read("scattering", config.scattering);
  reader.read_choice("field", config.field, kSwitches);
  reader.read("field_photons", config.field_photons);
  reader.read("field_error", config.field_error);
  reader.read("field_cell_m", config.field_cell_m);
  reader.read_choice("temporal_reuse", config.temporal_reuse, kSwitches);
  reader.read("late_decode_s", config.late_decode_s);
  reader.read("glide_paths", config.glide_paths);
  reader.read("bands", config.bands);
  reader.read("sample_rate_hz", config.sample_rate_hz);
  reader.read("seed", config.seed);
  reader.read("threads", config.threads);
  // Its default depends on no other key, so only a value that was given can contradict them; where it has no effect it is not recorded.
  const bool has_effect = config.field != Switch::on && config.source_rays == 0 && config.specular_exponent == 0.f;
  if (!has_effect && config.diffuse_last_segment && !reader.has("diffuse_last_segment")) return;
  reader.read("diffuse_last_segment", config.diffuse_last_segment);
  if (has_effect || !config.diffuse_last_segment) return;
  if (config.field == Switch::on)
    throw InputError("diffuse_last_segment = true", "has no effect on a source field", "leave it out, or set field=off");
  throw InputError("diffuse_last_segment = true", "has no effect on bidirectional tracing",
                   "leave it out, or set source_rays=0 specular_exponent=0");
}

void validate(const AcousticConfig& config) {
  require(config.early_order >= 0 && config.early_order <= 4, "early_order", config.early_order,
          "must be in [0, 4]: the number of image paths grows exponentially with it");
  require(config.early_candidate_rays >= 0 && config.early_candidate_rays <= 10'000'000, "early_candidate_rays",
          config.early_candidate_rays, "must be in [0, 10000000]");
  require(config.diffraction_order >= 1 && config.diffraction_order <= 10, "diffraction_order", config.diffraction_order,
          "must be in [1, 10]");
  require(config.diffraction_edge_m > 0.f && in_range(config.diffraction_edge_m, 0.f, 100.f), "diffraction_edge_m",
          config.diffraction_edge_m, "must be in (0, 100] m");
  require(config.diffraction_paths >= 1 && config.diffraction_paths <= 10'000, "diffraction_paths", config.diffraction_paths,
          "must be in [1, 10000]");
  require(config.diffraction_reflections == 0 || config.diffraction_reflections == 1, "diffraction_reflections",
          config.diffraction_reflections, "must be 0 or 1");
  require(config.transmission_walls >= 1 && config.transmission_walls <= 50, "transmission_walls", config.transmission_walls,
          "must be in [1, 50]");
  require(config.source_rays >= 0 && config.source_rays <= 1 << 20, "source_rays", config.source_rays, "must be in [0, 2^20]");
  require(config.source_bounces >= 1 && config.source_bounces <= 60, "source_bounces", config.source_bounces, "must be in [1, 60]");
  require(std::int64_t{config.source_rays} * config.source_bounces <= 1 << 23, "source_rays", config.source_rays,
          "times source_bounces must be at most 2^23: all vertices are stored");
  require(config.specular_exponent == 0.f || in_range(config.specular_exponent, 1.f, 1000.f), "specular_exponent", config.specular_exponent,
          "must be 0 (mirror) or in [1, 1000]");
  require(config.rays >= 0, "rays", config.rays, "must be in [0, 2^31): each ray carries 1/rays of the energy");
  require(config.max_bounces >= 0, "max_bounces", config.max_bounces, "must not be negative");
  require(config.time_bin_s > 0.f && in_range(config.time_bin_s, 1e-5f, 0.1f), "time_bin_s", config.time_bin_s,
          "must be in [0.00001, 0.1] s");
  require(config.sh_order >= 0 && config.sh_order <= 5, "sh_order", config.sh_order, "must be in [0, 5]");
  require(in_range(config.rir_length_s, 0.f, 60.f), "rir_length_s", config.rir_length_s, "must be in (0, 60] s, or auto");
  require(config.rir_length_s / config.time_bin_s <= 1e6f, "rir_length_s", config.rir_length_s,
          "needs more than a million bins of time_bin_s; reduce it, or increase time_bin_s");
  require(in_range(config.source_radius_m, 0.f, 100.f), "source_radius_m", config.source_radius_m, "must be in (0, 100] m, or auto");
  require(std::isfinite(config.scattering) && config.scattering <= 1.f, "scattering", config.scattering,
          "must be in [0, 1], or negative to use the scattering of each material");
  require(config.field_photons >= 512 && config.field_photons <= 1 << 24, "field_photons", config.field_photons, "must be in [512, 2^24]");
  require(config.field_error > 0.f && config.field_error <= 1.f, "field_error", config.field_error, "must be in (0, 1]");
  require(in_range(config.field_cell_m, 0.05f, 10.f), "field_cell_m", config.field_cell_m, "must be in [0.05, 10] m");
  require(in_range(config.late_decode_s, 0.f, 60.f), "late_decode_s", config.late_decode_s, "must be in [0, 60] s");
  require(config.glide_paths >= 0 && config.glide_paths <= 64, "glide_paths", config.glide_paths, "must be in [0, 64]");
  require(config.bands >= 0 && config.bands <= kMaxBands, "bands", config.bands, "must be in [1, 32], or 0 for octaves from 125 Hz");
  require(in_range(config.sample_rate_hz, 8000.f, 96000.f), "sample_rate_hz", config.sample_rate_hz, "must be in [8000, 96000] Hz");
  require(config.threads >= 0 && config.threads <= 4096, "threads", config.threads, "must be in [0, 4096]; 0: all cores");
}

}  // namespace earshot
