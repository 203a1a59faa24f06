// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/measured/sofa_convention.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

namespace earshot {
namespace {

struct Convention {
  std::string_view name;
  std::string_view contents;  ///< empty: impulse responses
};
constexpr std::string_view kTransfer = "transfer functions, not impulse responses";
constexpr std::string_view kSections = "second-order sections, not impulse responses";
constexpr std::string_view kRadiation = "the directivity of a source, not head responses";
/// AES69-2022, annex D, with names of earlier editions and of the SOFA toolbox.
constexpr std::array<Convention, 29> kConventions{{{"SimpleFreeFieldHRIR", ""},
                                                   {"SimpleFreeFieldHRTF", kTransfer},
                                                   {"SimpleFreeFieldTF", kTransfer},
                                                   {"SimpleFreeFieldSOS", kSections},
                                                   {"SimpleFreeFieldHRSOS", kSections},
                                                   {"FreeFieldHRIR", ""},
                                                   {"FreeFieldHRTF", kTransfer},
                                                   {"FreeFieldDirectivityTF", kRadiation},
                                                   {"FreeFieldDirectivityIR", kRadiation},
                                                   {"FreeFieldDirectivitySOS", kRadiation},
                                                   {"SimpleHeadphoneIR", "headphone responses, not responses per direction"},
                                                   {"SimpleHeadphoneTF", "headphone responses, not responses per direction"},
                                                   {"SimpleHeadphoneSOS", "headphone responses, not responses per direction"},
                                                   {"GeneralFIR", ""},
                                                   {"GeneralFIRE", ""},
                                                   {"GeneralFIR-E", ""},
                                                   {"GeneralTF", kTransfer},
                                                   {"GeneralTFE", kTransfer},
                                                   {"GeneralTF-E", kTransfer},
                                                   {"GeneralSOS", kSections},
                                                   {"GeneralString", "text, not impulse responses"},
                                                   {"SingleRoomDRIR", "room responses, not head responses in a free field"},
                                                   {"SingleRoomSRIR", "room responses, not head responses in a free field"},
                                                   {"SingleRoomMIMOSRIR", "room responses, not head responses in a free field"},
                                                   {"MultiSpeakerBRIR", "room responses, not head responses in a free field"},
                                                   {"SimpleBRIR", "room responses, not head responses in a free field"},
                                                   {"SingleTrackedAudio", "a recording, not impulse responses"},
                                                   {"AnnotatedReceiverAudio", "a recording, not impulse responses"},
                                                   {"AnnotatedEmitterAudio", "a recording, not impulse responses"}}};

bool is_part_of_name(char c) { return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-' || c == '_'; }

const Convention* convention_named(std::string_view name) {
  const auto* found = std::ranges::find(kConventions, name, &Convention::name);
  return found == kConventions.end() ? nullptr : found;
}

/// The first name of a convention in these bytes, as a word of its own.
std::string_view first_name_in(std::string_view bytes) {
  for (std::size_t at = 0; at < bytes.size();) {
    if (!is_part_of_name(bytes[at])) {
      ++at;
      continue;
    }
    std::size_t end = at;
    while (end < bytes.size() && is_part_of_name(bytes[end])) ++end;
    if (convention_named(bytes.substr(at, end - at))) return bytes.substr(at, end - at);
    at = end;
  }
  return {};
}

}  // namespace

std::string find_sofa_convention(std::string_view file) {
  // HDF5 writes an attribute as name, type, space, value; the heads between them take less than 200 bytes.
  constexpr std::string_view attribute = "SOFAConventions";
  constexpr std::size_t heads = 200;
  for (std::size_t at = file.find(attribute); at != std::string_view::npos; at = file.find(attribute, at + 1)) {
    const std::size_t value = at + attribute.size();
    if (value < file.size() && is_part_of_name(file[value])) continue;  // SOFAConventionsVersion
    if (const std::string_view name = first_name_in(file.substr(value, heads)); !name.empty()) return std::string(name);
  }
  return {};
}

std::optional<std::string> refusal_of_convention(std::string_view convention) {
  const Convention* known = convention_named(convention);
  if (!known || known->contents.empty()) return std::nullopt;
  return fmt::format("contains {} (SOFA convention {})", known->contents, convention);
}

}  // namespace earshot
