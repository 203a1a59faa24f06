// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "trainer/curves/event_log.h"

namespace earshot {

/// A picture of a run: success and SPL (left axis, 0 to 1) and mean reward (a panel below) over env steps, as a self-contained SVG.  Where
/// there are evaluations on held-out episodes, their success by either way of acting with its interval, and a ring at the best one.
/// Points without finished episodes are left out; an empty curve gives the empty axes.
std::string curve_svg(const std::string& title, const std::vector<CurvePoint>& points);

}  // namespace earshot
