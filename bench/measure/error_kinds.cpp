// SPDX-License-Identifier: Apache-2.0
#include "bench/measure/error_kinds.h"

#include <array>
#include <limits>

namespace earshot {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr const char* kIsoTime = "ISO 3382-1, table A.1 (for EDT)";
constexpr const char* kIsoLevel = "ISO 3382-1, table A.1 (for G)";

constexpr std::array<ErrorKindFacts, kNumErrorKinds> kFacts{{
    {"t20_pct", "T20", 100, true, false, 5, kIsoTime},
    {"t30_pct", "T30", 100, true, false, 5, kIsoTime},
    {"edt_pct", "EDT", 100, true, false, 5, "ISO 3382-1, table A.1"},
    {"c50_db", "C50", 1, false, false, 1, "ISO 3382-1, table A.1 (for C80); Bradley et al. 1999 find 1.1 dB"},
    {"drr_band_db", "DRR per band", 1, false, false, 1, "ours, that of C50; Zahorik 2002 finds 5 to 6 dB"},
    {"early_db", "level of the first 50 ms", 1, false, false, 1, kIsoLevel},
    {"level_db", "level", 1, false, false, 1, kIsoLevel},
    {"drr_db", "DRR", 1, false, false, 1, "ours, that of C50; Zahorik 2002 finds 5 to 6 dB"},
    {"edc_rms_db", "EDC", 1, false, true, kNone, ""},
    {"rir_t20_pct", "T20 of the rendered RIR", 100, true, false, 5, kIsoTime},
    {"rir_to_rir_t20_pct", "T20, rendered to rendered", 100, true, false, 5, kIsoTime},
    {"ild_db", "ILD", 1, false, false, 1, "Mills 1960 (0.5 to 1 dB)"},
    {"itd_us", "ITD", 1e6, false, false, 40, "ours, four times what trained listeners reach (Klumpp and Eady 1956)"},
    {"iacc", "IACC", 1, false, false, 0.075, "ISO 3382-1, table A.1"},
    {"lsd_db", "spectrogram", 1, false, true, kNone, ""},
}};

}  // namespace

const ErrorKindFacts& facts_of(ErrorKind kind) { return kFacts[static_cast<std::size_t>(kind)]; }

std::vector<ErrorKind> all_error_kinds() {
  std::vector<ErrorKind> kinds;
  for (int kind = 0; kind < kNumErrorKinds; ++kind) kinds.push_back(static_cast<ErrorKind>(kind));
  return kinds;
}

}  // namespace earshot
