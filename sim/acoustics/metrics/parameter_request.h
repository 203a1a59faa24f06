// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace earshot {

/// Parameters that are computed on request only.  Needs of each: docs/reference/room_parameters.md.
struct ParameterRequest {
  bool lateral = false;     ///< J_LF, J_LFC and LG: harmonics, or a figure-of-eight channel
  bool stage = false;       ///< ST_early and ST_late: a listener at 1 m from the source
  bool speech = false;      ///< MTI and STI: the seven octaves from 125 Hz to 8 kHz
  bool interaural = false;  ///< standard errors of IACC, which exist for two ears anyway
  /// Axis of the figure-of-eight microphone (unit, world axes; see lateral_axis()), which `lateral` needs for an energy response; nullopt:
  /// there is none.
  std::optional<glm::vec3> lateral_axis = std::nullopt;
  /// Ratio of speech to noise for STI, one for all octaves or one for each of the seven; empty: no noise.
  std::vector<double> snr_db{};

  [[nodiscard]] bool any() const { return lateral || stage || speech || interaural; }
};

/// Names of the groups, in messages and help texts.
inline constexpr std::string_view kParameterGroups = "lateral, stage, speech, interaural";

/// Reads names of groups; `key` is what messages call them, `snr_key` the ratios.  Throws InputError for an unknown name, ratios that are
/// not finite, ratios without `speech`, or neither one nor seven of them.
ParameterRequest parameter_request(const std::vector<std::string>& names, const std::vector<double>& snr_db, const std::string& key,
                                   const std::string& snr_key);

/// Horizontal, with its null toward the source (ISO 3382-1:2009, A.2.4); nullopt straight above or below it.
std::optional<glm::vec3> lateral_axis(glm::vec3 source, glm::vec3 listener);

}  // namespace earshot
