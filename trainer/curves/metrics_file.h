// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

#include "trainer/curves/event_log.h"

namespace earshot {

/// A curve point as text for Prometheus (text format 0.0.4), each family with HELP and TYPE: `episodes/success` is
/// earshot_episodes_success, with its unit at the end of the name (`_seconds`, `_meters`); values of one worker (`workers/3/update_s`) are
/// one family with the label worker="3".  Counters since the start of the run end in _total.  Values that are not there are left out. run:
/// label of all.
std::string prometheus_text(const CurvePoint& point, const std::string& run);

/// Writes it so that a reader sees the old file or this one.  Throws RunError.
void write_metrics_file(const std::filesystem::path& file, const CurvePoint& point, const std::string& run);

}  // namespace earshot
