// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

#include "trainer/run/run_config.h"

namespace earshot {

/// A run config whose env.acoustics.field says on or off.
struct FieldDecision {
  RunConfig config;
  std::string text;  ///< one line on what `auto` came to; empty where the config says itself
};

/// Replaces env.acoustics.field = auto by what choose_field finds for the episodes of data.train.file over total_steps, or, with `resume`,
/// by what the run of that checkpoint has; and gives fields a folder, `fields` under config.out, unless env.field_store names one.  The
/// same for every process and at any time: a function of the config and its episode set.  Off where there is no such set.  To be called
/// after env.accuracy is planned.  Throws InputError for a damaged set or checkpoint.
FieldDecision decide_field(const RunConfig& config, const std::filesystem::path& resume = {});

}  // namespace earshot
