// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <glm/vec3.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace earshot {

/// Responses between measured places of one room, as a SOFA file of the conventions SingleRoomSRIR or SingleRoomDRIR holds them.
struct RoomResponses {
  static constexpr std::size_t kMaxResponses = 100000, kMaxValues = std::size_t{1} << 26;
  struct Response {
    glm::dvec3 source_m{0}, listener_m{0};  ///< axes of a scene: x right, y up, z back; the file's x is -z, its y is -x
    glm::dvec3 source_front{0, 0, -1};      ///< unit
    double delay_samples = 0;               ///< time of the first sample
  };
  float sample_rate_hz = 0;
  std::size_t num_samples = 0;      ///< of each response
  std::vector<Response> responses;  ///< measurement by measurement, microphone by microphone
  std::vector<float> samples;       ///< [response][sample], any scale
};

/// Throws InputError naming `where` unless the lists have sizes in range that agree, and all numbers are finite and in range.
void validate(const RoomResponses& room, const std::string& where);

/// As bytes, for the answer of another process.  decode_room throws InputError for bytes that do not decode to valid responses.
std::string encode_room(const RoomResponses& room);
RoomResponses decode_room(std::string_view bytes, const std::string& where);

}  // namespace earshot
