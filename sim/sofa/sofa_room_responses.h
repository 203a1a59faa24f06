// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace earshot {

/// Responses of one source in one room at several listeners, for a file of the convention SingleRoomSRIR 1.0 (AES69-2022).  Axes of SOFA:
/// right-handed, x ahead, y to the left, z up; metres.
struct SofaRoomResponses {
  std::string title, room_description, listener_description, comment;
  float sample_rate_hz = 0;
  int num_receivers = 0, num_samples = 0;
  std::vector<float> samples;  ///< [listener][receiver][sample]
  struct Frame {
    glm::dvec3 position{0}, view{1, 0, 0}, up{0, 0, 1};  ///< view and up: unit, at a right angle
  };
  Frame source;
  std::vector<Frame> listeners;                              ///< [listener], in axes of the room
  std::vector<Frame> receivers;                              ///< [receiver], in axes of the listener; unused for harmonics
  bool harmonics = false;                                    ///< receivers are spherical harmonics by ACN, not points
  std::optional<std::pair<glm::dvec3, glm::dvec3>> shoebox;  ///< two opposite corners, of rooms that are boxes
  double temperature_k = 293.15;
};

}  // namespace earshot
