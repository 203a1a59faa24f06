// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/core/acoustic_config.h"

#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

const std::map<std::string, Switch> kSwitches = {{"auto", Switch::automatic}, {"on", Switch::on}, {"off", Switch::off}};

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

namespace {

/// Whether a key is read and recorded: those that came after the first benchmarks only where they are given or differ from the default, so
/// that a hash of what agents sense does not depend on a key that no one uses.
bool is_told(ConfigReader& reader, const std::string& key, bool differs) { return differs || reader.asks_for(key); }

void read_parts(ConfigReader& reader, AcousticConfig& config) {
  reader.read_choice("direct", config.direct, kSwitches, "Direct sound. auto: the effect plan decides.");
  reader.read_choice("early", config.early, kSwitches, "Early specular reflections, from image paths. auto: the effect plan decides.");
  reader.read_choice("late", config.late, kSwitches, "Late sound, from traced rays or a source field. auto: the effect plan decides.");
  reader.read_choice("diffraction", config.diffraction, kSwitches, "Diffraction around edges. auto: the effect plan decides.");
  reader.read_choice("transmission", config.transmission, kSwitches, "Transmission through walls. auto: the effect plan decides.");
  if (is_told(reader, "wall_power", config.wall_power != Switch::automatic))
    reader.read_choice("wall_power", config.wall_power, kSwitches,
                       "Rise of late sound where a source or a listener is near walls (Waterhouse 1955). auto: in bands that it changes by "
                       "more than 0.1 dB.");
  reader.read_choice("air_absorption", config.air_absorption, kSwitches, "Absorption in air (ISO 9613-1). auto: the effect plan decides.");
}

void read_early(ConfigReader& reader, AcousticConfig& config) {
  if (is_told(reader, "direct_rays", config.direct_rays != AcousticConfig{}.direct_rays))
    reader.read("direct_rays", config.direct_rays, Allowed::between(0, 4096),
                "Points of a source with a radius whose sight from the listener decides its direct sound. 0 or 1: its centre alone. No "
                "effect on point sources.");
  reader.read("early_order", config.early_order, Allowed::between(0, 4).because("the number of image paths grows exponentially with it"),
              "Largest number of specular reflections of an image path.");
  reader.read("early_candidate_rays", config.early_candidate_rays, Allowed::between(0, 10'000'000),
              "Rays traced once per source to find the sequences of planes of image paths.");
  reader.read("diffraction_order", config.diffraction_order, Allowed::between(1, 10), "Largest number of edges in a diffraction path.");
  reader.read("diffraction_edge_m", config.diffraction_edge_m, Allowed::above(0).up_to(100), "Length below which edges are left out.");
  reader.read("diffraction_paths", config.diffraction_paths, Allowed::between(1, 10'000),
              "Number of diffraction paths that are kept, the strongest first.");
  reader.read("diffraction_reflections", config.diffraction_reflections, Allowed::between(0, 1),
              "Reflections in large planes on either side of the edges of a diffraction path.");
  reader.read("transmission_walls", config.transmission_walls, Allowed::between(1, 50),
              "Largest number of walls that sound passes in a straight line.");
}

void read_late(ConfigReader& reader, AcousticConfig& config) {
  reader.read("rays", config.rays, Allowed::at_least(0).because("each ray carries 1/rays of the energy"),
              "Rays traced from the listener for each response. More rays: less noise, and proportionally more time.");
  reader.read("source_rays", config.source_rays, Allowed::between(0, 1 << 20),
              "Rays traced from the source for bidirectional path tracing. 0: rays from the listener only.");
  reader.read("source_bounces", config.source_bounces, Allowed::between(1, 60),
              "Reflections of a source ray that are kept; only with source_rays above 0.");
  reader.read(
      "specular_exponent", config.specular_exponent, Allowed::between(0, 1000).or_word("from_scattering", -1),
      "Exponent n of the lobe cos^n of specular reflections, at least 1. 0: reflections as from a mirror. from_scattering: one lobe "
      "for all reflections, n = 3 / s - 3 of the scattering coefficient s of each material and band.");
  reader.read("max_bounces", config.max_bounces, Allowed::at_least(0),
              "Largest number of reflections of a ray, a safety bound: time and Russian roulette end rays earlier.");
  reader.read("time_bin_s", config.time_bin_s, Allowed::between(1e-5, 0.1), "Width of a time bin of the energy response.");
  reader.read("sh_order", config.sh_order, Allowed::between(0, 5),
              "Order of the spherical harmonics of the arrival directions of late sound.");
  reader.read("rir_length_s", config.rir_length_s, Allowed::above(0).up_to(60).or_word("auto", 0),
              "Length of a response. auto: as long as the decay of the scene needs, at most 4 s.");
  reader.read(
      "source_radius_m", config.source_radius_m, Allowed::above(0).up_to(100).or_word("auto", 0),
      "Radius of the sphere in which specular paths meet the source, without diffuse_last_segment. auto: a twelfth of the mean free "
      "path, within 0.25 to 2 m.");
  reader.read("scattering", config.scattering, Allowed::any().up_to(1),
              "Scattering coefficient for every material. Negative: each material has its own.");
}

void read_field(ConfigReader& reader, AcousticConfig& config) {
  reader.read_choice(
      "field", config.field, kSwitches,
      "Late sound from a source field: photons are traced once per source, and each pose gathers from them. auto: where a source "
      "is heard from many poses and the field costs less than rays.");
  reader.read("field_photons", config.field_photons, Allowed::between(512, 1 << 24), "Largest number of photons of a source field.");
  reader.read("field_error", config.field_error, Allowed::above(0).up_to(1),
              "Relative standard error of T20 below which no more photons are added to a source field.");
  reader.read("field_cell_m", config.field_cell_m, Allowed::between(0.05, 10), "Edge of the cells of a source field, approximately.");
  reader.read_choice(
      "temporal_reuse", config.temporal_reuse, kSwitches,
      "Blends traced late sound along a trajectory, which reduces noise. auto: where the source moves. No effect on a single "
      "response.");
  reader.read(
      "late_decode_s", config.late_decode_s, Allowed::between(0, 60),
      "Binaural: late sound up to this time after its onset is rendered through the head as a first-order sound field; what follows has "
      "the right level and interaural correlation only.");
  reader.read(
      "glide_paths", config.glide_paths, Allowed::between(0, 64),
      "Number of the strongest paths whose delays move smoothly from pose to pose along a trajectory. 0: none. No effect on a single "
      "response.");
}

}  // namespace

void read(ConfigReader& reader, AcousticConfig& config) {
  read_parts(reader, config);
  read_early(reader, config);
  read_late(reader, config);
  read_field(reader, config);
  reader.read("bands", config.bands, Allowed::between(1, kMaxBands).or_value(0),
              "Number of logarithmically spaced frequency bands. 0: octaves from 125 Hz to 16 kHz, up to half the sample rate.");
  if (is_told(reader, "low_octave", config.low_octave))
    reader.read("low_octave", config.low_octave,
                "Adds an octave at 63 Hz; only with bands 0. Without it sound below 89 Hz is that of 125 Hz.");
  reader.read("sample_rate_hz", config.sample_rate_hz, Allowed::between(8000, 96000), "Sample rate of responses and sounds.");
  reader.read("seed", config.seed, "Seed of rays and noise carriers; the same seed gives the same bits.");
  reader.read("threads", config.threads, Allowed::between(0, 4096),
              "Threads of one response. 0: all cores. Any number gives the same bits.");
  // Its default depends on no other key, so only a value that was given can contradict them; where it has no effect it is not recorded.
  const bool has_effect = config.field != Switch::on && config.source_rays == 0 && config.specular_exponent == 0.f;
  if (!has_effect && config.diffuse_last_segment && !reader.asks_for("diffuse_last_segment")) return;
  reader.read("diffuse_last_segment", config.diffuse_last_segment,
              "Treats the last segment of late paths as diffuse: far less noise for a small bias. false: unbiased.");
  if (has_effect || !config.diffuse_last_segment || reader.is_describing()) return;
  if (config.field == Switch::on)
    throw InputError("diffuse_last_segment = true", "has no effect on a source field", "leave it out, or set field=off");
  throw InputError("diffuse_last_segment = true", "has no effect on bidirectional tracing",
                   "leave it out, or set source_rays=0 specular_exponent=0");
}

BandLayout bands_of(const AcousticConfig& config) {
  return config.bands > 0 ? BandLayout::log_spaced(config.bands, config.sample_rate_hz)
                          : BandLayout::octaves(config.sample_rate_hz, config.low_octave);
}

void validate(const AcousticConfig& config) {
  check_values(config, "");
  require(config.specular_exponent <= 0.f || config.specular_exponent >= 1.f, "specular_exponent", config.specular_exponent,
          "must be 0, at least 1, or from_scattering: a lobe wider than cos^1 has no mirror direction to speak of");
  require(std::int64_t{config.source_rays} * config.source_bounces <= 1 << 23, "source_rays", config.source_rays,
          "times source_bounces must be at most 2^23: all vertices are stored");
  require(config.bands == 0 || !config.low_octave, "low_octave", config.low_octave, "has no effect on log-spaced bands; set bands to 0");
  require(config.rir_length_s / config.time_bin_s <= 1e6f, "rir_length_s", config.rir_length_s,
          "needs more than a million bins of time_bin_s; reduce it, or increase time_bin_s");
}

}  // namespace earshot
