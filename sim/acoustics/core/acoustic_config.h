// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "sim/acoustics/core/bands.h"
#include "sim/base/text/config_reader.h"

namespace earshot {

enum class Switch { automatic, on, off };

/// Every parameter of a RIR.  Defaults are the preset `fast`.  `--set key=value`, preset files and task configs use the names below.
struct AcousticConfig {
  // which parts
  Switch direct = Switch::automatic, early = Switch::automatic, late = Switch::automatic, air_absorption = Switch::automatic;
  Switch diffraction = Switch::automatic, transmission = Switch::automatic;
  Switch wall_power = Switch::automatic;  ///< late sound of sources and listeners near walls (wall_power.h)
  /// Points of a source with a radius that are looked for from the listener (sphere_arrivals.h), [0, 4096]; 0 or 1: its centre alone.
  /// No part of a point source.
  int direct_rays = 64;
  // early reflections
  int early_order = 2;              ///< image paths up to this many specular reflections, [0, 4]
  int early_candidate_rays = 2000;  ///< rays traced once per source to find plane sequences
  // diffraction; automatic: as much as is cheap beside the rays, with few rays not where reflections end (DiffractionBudget)
  int diffraction_order = 3;         ///< edges in a row, [1, 10]
  float diffraction_edge_m = 0.25f;  ///< shorter edges are left out, (0, 100]
  int diffraction_paths = 64;        ///< strongest paths that are kept, [1, 10000]
  int diffraction_reflections = 0;   ///< in large planes, on either side of the edges of a path, [0, 1]; `high`: 1
  // transmission
  int transmission_walls = 8;  ///< in a row, [1, 50]
  // late field
  int rays = 64;            ///< from the listener, [0, 2^31)
  int max_bounces = 1000;   ///< a safety bound; time and Russian roulette end rays
  int source_rays = 0;      ///< > 0: bidirectional path tracing with this many rays from the source, unless field is on, [0, 2^20]
  int source_bounces = 10;  ///< of those, [1, 60]
  /// 0: specular reflections leave as from a mirror.  > 0: in a lobe of cos^n about it, normalised to keep all energy, [1, 1000].
  /// -1 or `from_scattering`: all reflections leave in one lobe, whose exponent is 3 / s - 3 of the scattering s (lobe_shares.h).
  float specular_exponent = 0.f;
  float time_bin_s = 0.004f;  ///< (0, 0.1]
  int sh_order = 1;           ///< of the arrival directions, [0, 5]
  float rir_length_s = 0.5f;  ///< (0, 60]; 0 or `auto`: as long as the scene's decay needs, at most 4 s (effect_plan.h)
  /// Sphere in which specular paths meet the source, unless diffuse_last_segment; 0 or `auto`: a twelfth of the mean free path, within
  /// [0.25, 2] m (effect_plan.h).
  float source_radius_m = 0.f;
  /// false: next-event estimation connects the diffuse part only, specular last segments are caught by the source volume (unbiased, noisy).
  /// true: the last segment of late paths is treated as diffuse (the fraction s of scattering as 1): far less noise, small bias (a
  /// furnished house with scattering near 0.1: T20 within 5 %, T30 within 9 %, level within 0.4 dB).
  bool diffuse_last_segment = true;
  float scattering = -1.f;  ///< >= 0: one value for every material
  // source field (source_field.h): the late field of a source that stands still, built once and gathered at each pose
  Switch field = Switch::automatic;  ///< automatic: where a source is held for many poses and the field is the cheaper way (effect plan)
  int field_photons = 1 << 16;       ///< at most, from the source, [512, 2^24]
  float field_error = 0.037f;        ///< photons are added until the relative standard error of T20 is below this, (0, 1]
  float field_cell_m = 1.f;          ///< about the edge of the cells that share a history, [0.05, 10]
  /// Blend of traced late fields along a trajectory (temporal_reuse.h); automatic: where the source moves.  No part of a single response.
  Switch temporal_reuse = Switch::automatic;
  // output
  /// Binaural: late sound up to so long after its beginning goes through the head as a sound field of first order; what comes later has, by
  /// its direction, the right level at each ear and the right correlation between them (binaural_noise.h), [0, 60].  Where what comes later
  /// has a mean direction of more than 0.15 (of 1 for a single direction), more is decoded; from 0.25 on all but the last hundredth.
  float late_decode_s = 0.16f;
  /// Along a trajectory (walk, environments) so many of the strongest paths glide from pose to pose, 0: none (path_glide.h).  No part of a
  /// single response.  [0, 64].
  int glide_paths = 3;
  int bands = 0;                   ///< 0: octaves; otherwise this many log-spaced bands
  bool low_octave = false;         ///< with octaves: one at 63 Hz too
  float sample_rate_hz = 16000.f;  ///< [8000, 96000]
  std::uint64_t seed = 0;
  int threads = 1;  ///< 0: all; any number gives the same bits
};

/// Presets `fast` (training), `balanced`, `high` (converged reference).  Throws InputError for another name.
AcousticConfig acoustic_preset(std::string_view name);
/// Reads any of the fields by name (switches as auto|on|off) over `config`; does not call finish().
void read(ConfigReader& reader, AcousticConfig& config);
/// Bands of responses under `config`.
BandLayout bands_of(const AcousticConfig& config);
/// Throws InputError with key, value, rule.
void validate(const AcousticConfig& config);

}  // namespace earshot
