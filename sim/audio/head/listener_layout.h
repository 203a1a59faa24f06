// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <glm/gtc/quaternion.hpp>
#include <glm/vec3.hpp>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "sim/audio/head/directivity.h"

namespace earshot {

class ConfigReader;

/// What ListenerLayout::named reads: of a key of a config, and for help texts and messages.
inline constexpr About kChannelsAbout(
    "Channels: mono[:PATTERN], stereo[:xy|:ms|:ab|:ortf], binaural, quad, surround_5_1, surround_7_1, "
    "ambisonic:ORDER[:n3d|:sn3d][:world|:ego] or array:FILE.");
inline constexpr std::string_view kListenerLayouts = kChannelsAbout.text().substr(10, kChannelsAbout.text().size() - 11);

enum class ChannelLayout { mono, binaural };

enum class ListenerKind { mono, binaural, ambisonics, array };
enum class HarmonicNorm { n3d, sn3d };
/// world: the axes of the scene, independent of the orientation of the listener.  ego: those of the listener.
enum class HarmonicAxes { world, ego };

/// One microphone of an array, in the listener's axes (x right, y up, -z front).
struct Microphone {
  glm::vec3 position_m{0};                                   ///< from the listener's position
  std::shared_ptr<const Directivity> directivity = nullptr;  ///< null: omnidirectional
  glm::quat orientation{1, 0, 0, 0};                         ///< own axes to the listener's; unit
  float lowpass_hz = 0;                                      ///< of its signal (low_pass.h), [20, 20000]; 0: none
  std::string name{};

  /// a of a pattern a + (1 - a) cos at all frequencies; nullopt for any other.
  [[nodiscard]] std::optional<float> omni_weight() const { return directivity ? directivity->omni_weight() : 1.f; }
};

/// Output channels of a listener, as a plain value.  One channel: mono; two ears; (order + 1)^2 ambisonic channels in ACN order; one
/// channel per microphone.
struct ListenerLayout {
  ListenerLayout(ChannelLayout layout = ChannelLayout::mono)
      : kind(layout == ChannelLayout::mono ? ListenerKind::mono : ListenerKind::binaural) {}

  ListenerKind kind;
  int order = 1;  ///< ambisonics, [0, 9]
  HarmonicNorm norm = HarmonicNorm::n3d;
  HarmonicAxes axes = HarmonicAxes::world;
  std::vector<Microphone> microphones;         ///< array, [1, 256], each within 10 m
  std::vector<std::filesystem::path> files{};  ///< that it was read from: of an array and of patterns
  std::uint32_t channel_mask = 0;              ///< loudspeakers of the channels, as dwChannelMask of WAVEFORMATEXTENSIBLE; 0: none

  static ListenerLayout ambisonics(int order, HarmonicNorm norm = HarmonicNorm::n3d, HarmonicAxes axes = HarmonicAxes::world);
  static ListenerLayout array(std::vector<Microphone> microphones);
  /// One microphone with a pattern whose front is that of the listener: an array of one.
  static ListenerLayout mono(std::shared_ptr<const Directivity> directivity);
  /// mono, mono:PATTERN, binaural, ambisonic:ORDER (or ambisonics:ORDER) with any of :n3d :sn3d :world :ego, array:FILE.  Patterns as in
  /// Directivity::named.  stereo, quad and surround as in loudspeaker_layout.h: arrays.
  static ListenerLayout named(std::string_view text);
  /// YAML or JSON: `microphones`, a list of maps, all keys optional: `position_m` [x, y, z], `pattern` (as in Directivity::named; files
  /// relative to this one) or `omni_weight`, `azimuth_deg` counter-clockwise from the front, `elevation_deg`, `roll_deg` (its right side
  /// down), `lowpass_hz`, `name`.
  static ListenerLayout from_file(const std::filesystem::path& path);
  /// All keys of such a file.
  static std::vector<ConfigKey> keys();

  [[nodiscard]] int num_channels() const;
  /// Whether it is an array of first-order patterns that are all at the listener's position: its signals follow from first-order harmonics.
  [[nodiscard]] bool is_coincident() const;
  /// Of results: mono; left, right; acn0, acn1, ...; or those of the microphones, mic0, mic1, ... without a name.
  [[nodiscard]] std::vector<std::string> channel_names() const;
};

/// Throws InputError with key, value and rule.
void validate(const ListenerLayout& layout);

/// ListenerLayout::named of the value of a key; what it refuses is refused with the place of the key.
ListenerLayout read_layout(const ConfigReader& reader, const std::string& key, const std::string& value);

}  // namespace earshot
