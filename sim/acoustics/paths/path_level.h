#pragma once

#include <algorithm>
#include <cmath>

namespace earshot {

/// The frequency at which paths over edges are estimated and ranked before they are worked out.
inline constexpr double kRankingHz = 500;

/// Level of an amplitude; -240 dB and less count as that.
inline double level_db(double amplitude) { return 20.0 * std::log10(std::max(amplitude, 1e-12)); }

}  // namespace earshot
