#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"

namespace earshot {

/// Root mean square in dB between the decay curves of two series of the same bins, each relative to its own whole, over the bins where the
/// reference lies between 0 and -range_db.  A curve that has ended counts as kEndedDb.  nullopt without energy.
inline constexpr double kEndedDb = -60;
std::optional<double> decay_rms_db(std::span<const double> reference, std::span<const double> test, double range_db = 30);

/// Root mean square in dB between two pooled log(1 + x) spectrograms of the same shape, over the pixels whose reference lies within
/// range_db of its loudest.  Quieter pixels of the test count as that floor.  nullopt if the reference is silent.
std::optional<double> log_spectral_distance_db(std::span<const float> reference, std::span<const float> test, double range_db = 40);

/// Level of the left channel over the right one, dB; nullopt where one is silent or there are not two.
std::optional<double> level_difference_db(const Rir& rir);
/// Mean of the interaural correlations of the octaves 500 Hz to 2 kHz after `from_direct_s` (ISO 3382-1, IACC E3 or L3); nullopt if none.
std::optional<double> mean_interaural_correlation(const Rir& rir, double direct_delay_s);

/// Errors of one response at one pose.  Relative ones as fractions, differences as they come, both with a sign (test minus reference);
/// root-mean-square ones without.  Where the reference has a value and the test has none, the entry is NaN.
enum class ErrorKind { t20, t30, edt, c50_db, drr_db, decay_db, rir_t20, rir_to_rir_t20, ild_db, iacc, spectral_db, count };
inline constexpr int kNumErrorKinds = static_cast<int>(ErrorKind::count);
/// Name in files ("t20_pct"), and the factor from the unit above to that one.
const char* name_of(ErrorKind kind);
double scale_of(ErrorKind kind);

struct PoseErrors {
  std::vector<double> values[kNumErrorKinds];  ///< over bands, or one; empty where the reference has no value
};

/// Everything that is compared at one pose.
struct HeardResponse {
  RoomMetrics energy;                       ///< of the energy response
  std::vector<std::vector<double>> series;  ///< energy_series per band
  RoomMetrics rir;                          ///< of the rendered left ear, octaves
  std::optional<double> ild_db, iacc;       ///< of the rendered pair
  std::vector<float> spectrogram;
};
/// rir_t20: the test's rendered left ear against the energy of the reference, so the noise of carriers and the shadow of the head count.
/// rir_to_rir_t20: against the reference's rendered left ear, as the SoundSpaces 2.0 paper compares its modes.  Decay times of bands
/// are compared where both have the same bands; a test of other bands is compared by what is heard alone.
PoseErrors compare(const HeardResponse& reference, const HeardResponse& test);

/// Over poses: all bands of all poses weigh the same.
struct ErrorSummary {
  double mean = 0, rms = 0, p95 = 0;  ///< of absolute values
  double standard_error = 0;          ///< of the mean, from the spread of the poses' means; NaN with one pose
  int count = 0, missing = 0;         ///< values, and those that the test lacks
};
ErrorSummary summarise(std::span<const PoseErrors> poses, ErrorKind kind);

}  // namespace earshot
