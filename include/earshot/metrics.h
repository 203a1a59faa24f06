// SPDX-License-Identifier: Apache-2.0
#pragma once

/// @file
/// Room-acoustic parameters after ISO 3382-1.

#include <span>
#include <vector>

#include "earshot/errors.h"

namespace earshot::api {

struct Rir;

/// Room-acoustic parameters after ISO 3382-1, one value per band.  NaN: the value does not exist (no decay to fit, no direct sound).
struct Metrics {
  std::vector<double> bands_hz;                     ///< centres, low to high
  std::vector<double> edt_s;                        ///< early decay time: first 10 dB after the direct sound
  std::vector<double> t20_s, t30_s;                 ///< decay times from -5 to -25 dB and from -5 to -35 dB
  std::vector<double> rt60_s;                       ///< T30 if the decay reaches -35 dB, else T20
  std::vector<double> c50_db, c80_db, d50;          ///< clarity and definition
  std::vector<double> ts_s;                         ///< centre time
  std::vector<double> g_db;                         ///< strength
  std::vector<double> drr_band_db;                  ///< direct-to-reverberant ratio
  std::vector<double> iacc, iacc_early, iacc_late;  ///< interaural cross-correlation; of two-channel responses only
  double drr_db = 0;                                ///< broadband, of a source with equal energy per hertz
  double direct_delay_s = 0, direct_amplitude = 0;  ///< NaN without a line of sight
};

/// One entry of Metrics per band under its name, for loops over all of them.
struct MetricField {
  const char* name;  ///< "t20_s"
  std::vector<double> Metrics::*values;
};
/// Every field with one value per band, but bands_hz.
std::span<const MetricField> metric_fields();

/// Parameters of an impulse response, measured or computed: those of channel 0, and with two channels the correlation between them.  Octave
/// bands with zero-phase filters; a decay shorter than 16 / bandwidth is that of the filter.
/// @param rir             one channel or more.
/// @param direct_delay_s  time at which the direct sound arrives.
/// @throws InputError for an empty response, a sample rate that is not positive, or a negative delay.
Metrics measure(const Rir& rir, double direct_delay_s = 0);

}  // namespace earshot::api
