// SPDX-License-Identifier: Apache-2.0
#include "apps/options/parameter_options.h"

namespace earshot {

void ParameterOptions::add_to(CLI::App& command, const std::string& description) {
  command.add_option("--parameters", names, description)->delimiter(',');
  command
      .add_option("--speech-snr", speech_snr_db,
                  "Ratio of speech to noise in dB for STI: one, or seven from 125 Hz to 8 kHz (default: no noise)")
      ->delimiter(',');
}

ParameterRequest ParameterOptions::request() const { return parameter_request(names, speech_snr_db, "--parameters", "--speech-snr"); }

}  // namespace earshot
