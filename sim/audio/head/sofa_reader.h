// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <glm/vec3.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace earshot {

/// Measured head-related impulse responses as a SOFA file holds them.
struct SofaResponses {
  float sample_rate_hz = 0;
  int num_taps = 0;
  std::vector<glm::vec3> direction;  ///< unit, head axes: x right, y up, -z front
  std::vector<float> distance_m{};   ///< [direction], of the sources from the head's centre; empty: not known
  std::vector<float> taps;           ///< [direction][ear][num_taps], ears left, right
  std::vector<float> delay_samples;  ///< [direction][ear], to be added in front of the taps
};

/// Reads a SOFA file of the convention SimpleFreeFieldHRIR or one like it.  Directions are taken from the place and the view of the
/// listener. Files of the first API name the right ear first and hold the left one first: where the right ear is named first, level and
/// onset over all directions tell which it is (ear_order.h).  A file that holds no impulse responses of a head is refused by its
/// convention.  libmysofa reads it in a process of its own (isolated_call.h): release 1.3 writes past its stack on some damaged files.
/// Throws InputError naming the file and the field; RunError if that process cannot be started.
SofaResponses read_sofa(const std::filesystem::path& path);

/// The same within this process: for earshot_reader.
SofaResponses parse_sofa(const std::filesystem::path& path);

/// Throws InputError naming `where` unless the lists have the sizes that the counts say, directions are unit vectors, and all numbers are
/// finite and in range.
void validate(const SofaResponses& responses, const std::string& where);

/// Responses as bytes, for the answer of that process.  decode_responses throws InputError for bytes that do not decode to valid responses.
std::string encode_responses(const SofaResponses& responses);
SofaResponses decode_responses(std::string_view bytes, const std::string& where);

}  // namespace earshot
