// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <string>
#include <vector>

namespace earshot {

/// Metrics of the error of a response.  Values of a band come one per octave, low to high.
enum class ErrorKind {
  t20,
  t30,
  edt,
  c50_db,          ///< of the energy response, per band, as those before and the three below
  drr_band_db,     ///< nullopt out of sight
  early_db,        ///< level of the first 50 ms
  level_db,        ///< of everything (G of ISO 3382-1 up to a constant)
  drr_db,          ///< broadband, of equal energy per hertz
  decay_db,        ///< decay curve per band, while the truth lies within 30 dB of its start
  rir_t20,         ///< of the rendered left ear per band, against the energy of the truth
  rir_to_rir_t20,  ///< the same against the truth's rendered left ear
  ild_db,          ///< of the rendered pair per band, as the two below (interaural_bands.h)
  itd_us,
  iacc,
  spectral_db,  ///< final spectrogram
  count
};
inline constexpr int kNumErrorKinds = static_cast<int>(ErrorKind::count);

/// How a kind is written and judged.
struct ErrorKindFacts {
  const char* name;     ///< in files, with its unit: "t20_pct"
  const char* title;    ///< in tables
  double scale;         ///< from the unit of values (seconds as a fraction of the truth, dB, seconds of ITD) to that of files
  bool relative;        ///< error = value / truth - 1; otherwise value - truth
  bool curve;           ///< an item is many samples, its error their root mean square
  double noticeable;    ///< just-noticeable difference in the unit of files; NaN: none is agreed on
  const char* noticed;  ///< whose number that is
};
const ErrorKindFacts& facts_of(ErrorKind kind);
inline const char* name_of(ErrorKind kind) { return facts_of(kind).name; }
inline double scale_of(ErrorKind kind) { return facts_of(kind).scale; }
inline bool has_noticeable(ErrorKind kind) { return !std::isnan(facts_of(kind).noticeable); }
/// All of them, in the order of files.
std::vector<ErrorKind> all_error_kinds();

}  // namespace earshot
