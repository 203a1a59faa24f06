// SPDX-License-Identifier: Apache-2.0
#pragma once

/// @file
/// Room-acoustic parameters after ISO 3382-1.

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "earshot/errors.h"

namespace earshot::api {

struct Rir;

/// A parameter that was asked for and that a response does not have.
struct MissingMetric {
  std::string name;    ///< "j_lf"
  std::string reason;  ///< what it needs
};

/// Room-acoustic parameters after ISO 3382-1, one value per band.  NaN: the value does not exist (no decay to fit, no direct sound).
struct Metrics {
  std::vector<double> bands_hz;                     ///< centres, low to high
  std::vector<double> edt_s;                        ///< early decay time: 0 to -10 dB of the decay curve, direct sound included
  std::vector<double> edt_after_direct_s;           ///< of the first 10 dB below the step of the direct sound
  std::vector<double> t20_s, t30_s;                 ///< decay times from -5 to -25 dB and from -5 to -35 dB
  std::vector<double> rt60_s;                       ///< T30 if the decay reaches -35 dB, else T20
  std::vector<double> c50_db, c80_db, d50;          ///< clarity and definition
  std::vector<double> ts_s;                         ///< centre time
  std::vector<double> g_db;                         ///< strength; of samples with a reference or in Green units
  std::vector<double> drr_band_db;                  ///< direct-to-reverberant ratio
  std::vector<double> iacc, iacc_early, iacc_late;  ///< interaural cross-correlation; of two-channel responses only
  /// On request (ParameterOptions): lateral energy fractions, late lateral strength, stage support, modulation transfer index.
  std::vector<double> j_lf, j_lfc, lg_db, st_early_db, st_late_db, mti;
  double sti = 0;                                   ///< speech transmission index, on request
  double drr_db = 0;                                ///< broadband, of a source with equal energy per hertz
  double direct_delay_s = 0, direct_amplitude = 0;  ///< NaN without a line of sight
  std::vector<MissingMetric> missing;               ///< of those on request and of G, with reasons
};

/// Parameters that are computed on request only; docs/reference/room_parameters.md has what each needs.
struct ParameterOptions {
  /// Of lateral (J_LF, J_LFC, LG), stage (ST_early, ST_late), speech (MTI, STI), interaural (standard errors of IACC).
  std::vector<std::string> groups = {};
  std::vector<double> speech_snr_db = {};  ///< ratio of speech to noise: one, or seven from 125 Hz to 8 kHz; empty: no noise
};

/// One entry of Metrics per band under its name, for loops over all of them.
struct MetricField {
  const char* name;  ///< "t20_s"
  std::vector<double> Metrics::*values;
};
/// Every field with one value per band, but bands_hz and those on request.
std::span<const MetricField> metric_fields();
/// Those on request.
std::span<const MetricField> requested_metric_fields();

/// Reading of an impulse response.
struct MeasureOptions {
  /// Time at which the direct sound arrives; nullopt: the first sample within 20 dB of the strongest that stands above the noise (ISO
  /// 3382-1).
  std::optional<double> direct_delay_s = std::nullopt;
  std::string bands = "octaves";  ///< from 63 Hz to 16 kHz, as far as the rate reaches; or third_octaves from 100 Hz to 10 kHz
  ParameterOptions parameters = {};
  /// Response of a figure-of-eight microphone, its null toward the source, as long as the other one: lateral parameters need it.
  std::vector<float> lateral = {};
  /// Response of the same source and microphone at 10 m in a free field: G and LG refer to it.
  std::vector<float> reference = {};
  bool green_units = false;                         ///< the samples are in Green units, as Earshot renders them: G and LG need no reference
  std::optional<double> distance_m = std::nullopt;  ///< of the source, for stage parameters; nullopt: taken as 1 m
};

/// Parameters of an impulse response, measured or computed: those of channel 0, and with two channels the correlation between them.  Bands
/// with zero-phase filters; a decay shorter than 16 / bandwidth is that of the filter.
/// @param rir      one channel or more.
/// @param options  time zero, bands and further parameters.
/// @throws InputError for an empty response, samples that are not finite, a sample rate that is not positive, a time of the direct
///                  sound outside the response, and further responses that do not fit it.
Metrics measure(const Rir& rir, const MeasureOptions& options = {});
/// The same with the direct sound at direct_delay_s.
Metrics measure(const Rir& rir, double direct_delay_s);

}  // namespace earshot::api
