// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/App.hpp>
#include <string>
#include <vector>

#include "sim/acoustics/metrics/parameter_request.h"

namespace earshot {

/// `--parameters` and `--speech-snr`: room-acoustic parameters on request.
struct ParameterOptions {
  std::vector<std::string> names;
  std::vector<double> speech_snr_db;

  /// description: of the groups that the command has.
  void add_to(CLI::App& command, const std::string& description);
  /// Throws InputError for an unknown group, ratios without speech, and another number of ratios than one or seven.
  [[nodiscard]] ParameterRequest request() const;
};

}  // namespace earshot
