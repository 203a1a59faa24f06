// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/listener_layout.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <utility>

#include "sim/audio/head/ambisonics.h"
#include "sim/audio/head/layout_file.h"
#include "sim/audio/head/listener_orientation.h"
#include "sim/audio/head/loudspeaker_layout.h"
#include "sim/base/errors.h"
#include "sim/base/regular_file.h"
#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

constexpr std::size_t kMaxMicrophones = 256;
constexpr float kMaxOffsetM = 10.f;
constexpr std::size_t kMaxLayoutBytes = std::size_t{16} << 20;

constexpr About kMicrophonesAbout("Microphones, a channel each, in the listener's axes.");
constexpr float kMinLowpassHz = 20.f, kMaxLowpassHz = 20'000.f;

/// files: the file of its pattern is added.
Microphone read_microphone(ConfigReader& reader, const std::filesystem::path& folder, std::vector<std::filesystem::path>& files) {
  Microphone microphone;
  std::vector<float> position(3, 0.f);
  std::string pattern;
  float omni_weight = 1.f;
  double azimuth_deg = 0, elevation_deg = 0, roll_deg = 0;
  reader.read("name", microphone.name, "Name of the microphone.");
  reader.read("position_m", position, Allowed::between(-kMaxOffsetM, kMaxOffsetM).items(3),
              "Place from the listener: x right, y up, z back.");
  reader.read("omni_weight", omni_weight, Allowed::between(0, 1), "Weight a of the pattern a + (1 - a) cos; in place of pattern.");
  reader.read("pattern", pattern, Allowed::text("omni, cardioid, another pattern, voice, or a balloon file"),
              "Directional pattern: omni, subcardioid, cardioid, supercardioid, hypercardioid, dipole, voice, or a balloon file.");
  reader.read("azimuth_deg", azimuth_deg, "Direction of its front to the left of the listener's.");
  reader.read("elevation_deg", elevation_deg, "Direction of its front upwards.");
  reader.read("roll_deg", roll_deg, "Rotation about its front.");
  std::optional<float> lowpass_hz;
  reader.read("lowpass_hz", lowpass_hz, Allowed::between(kMinLowpassHz, kMaxLowpassHz),
              "Upper end of its signal (-3 dB, then 24 dB per octave), for a low-frequency channel. Absent: none.");
  reader.finish();
  if (reader.is_describing()) return microphone;
  const bool has_weight = reader.has("omni_weight"), has_pattern = !pattern.empty();
  if (has_weight && has_pattern) reader.fail("omni_weight", "is given together with pattern; give only one of them");
  microphone.lowpass_hz = lowpass_hz.value_or(0.f);
  microphone.position_m = {position[0], position[1], position[2]};
  if (has_weight) microphone.directivity = Directivity::first_order(omni_weight);
  if (has_pattern) {
    const bool is_file = std::filesystem::path(pattern).has_extension();
    microphone.directivity = Directivity::named(is_file ? (folder / pattern).string() : pattern);
    if (is_file) files.push_back(folder / pattern);
  }
  constexpr double degree = std::numbers::pi / 180.0;
  microphone.orientation = glm::quat(ListenerOrientation(azimuth_deg * degree, elevation_deg * degree, roll_deg * degree).local_to_world());
  return microphone;
}

/// Of results; a microphone without a name is called by its number.
std::string name_of(const Microphone& microphone, int number) {
  return microphone.name.empty() ? fmt::format("mic{}", number) : microphone.name;
}

std::optional<std::string> repeated_name(std::span<const Microphone> microphones) {
  std::set<std::string> names;
  for (std::size_t i = 0; i < microphones.size(); ++i) {
    const std::string name = name_of(microphones[i], static_cast<int>(i));
    if (!names.insert(name).second) return name;
  }
  return std::nullopt;
}

}  // namespace

ListenerLayout ListenerLayout::ambisonics(int order, HarmonicNorm norm, HarmonicAxes axes) {
  ListenerLayout layout;
  layout.kind = ListenerKind::ambisonics;
  layout.order = order, layout.norm = norm, layout.axes = axes;
  validate(layout);
  return layout;
}

ListenerLayout ListenerLayout::array(std::vector<Microphone> microphones) {
  ListenerLayout layout;
  layout.kind = ListenerKind::array;
  layout.microphones = std::move(microphones);
  validate(layout);
  return layout;
}

ListenerLayout ListenerLayout::mono(std::shared_ptr<const Directivity> directivity) {
  if (!directivity || directivity->omnidirectional()) return ChannelLayout::mono;
  std::vector<Microphone> omnidirectional(1);
  omnidirectional[0].directivity = std::move(directivity);
  return array(std::move(omnidirectional));
}

ListenerLayout ListenerLayout::named(std::string_view text) {
  const auto refuse = [&](std::string_view problem) {
    return InputError("listener '" + std::string(text) + "'", problem, "use " + std::string(kListenerLayouts));
  };
  const std::size_t colon = text.find(':');
  const std::string_view kind = text.substr(0, colon);
  std::string_view rest = colon == std::string_view::npos ? std::string_view() : text.substr(colon + 1);
  if (colon != std::string_view::npos && rest.empty()) throw refuse("ends with a colon");
  if (kind == "mono") {
    ListenerLayout layout = rest.empty() ? ListenerLayout(ChannelLayout::mono) : mono(Directivity::named(rest));
    if (names_file(text)) layout.files.emplace_back(rest);
    return layout;
  }
  if (text == "binaural") return ChannelLayout::binaural;
  if (kind == "array" && !rest.empty()) return from_file(std::filesystem::path(rest));
  if (std::optional<ListenerLayout> known = loudspeaker_layout(text)) return *std::move(known);
  if (kind != "ambisonics" && kind != "ambisonic") throw refuse("is not a known layout");
  ListenerLayout layout;
  layout.kind = ListenerKind::ambisonics;
  const auto [end, error] = std::from_chars(rest.data(), rest.data() + rest.size(), layout.order);
  if (error != std::errc()) throw refuse("has no order");
  rest.remove_prefix(static_cast<std::size_t>(end - rest.data()));
  while (!rest.empty()) {
    if (rest.front() != ':') throw refuse("has extra text after its order");
    rest.remove_prefix(1);
    const std::string_view word = rest.substr(0, rest.find(':'));
    rest.remove_prefix(word.size());
    if (word == "n3d")
      layout.norm = HarmonicNorm::n3d;
    else if (word == "sn3d")
      layout.norm = HarmonicNorm::sn3d;
    else if (word == "world")
      layout.axes = HarmonicAxes::world;
    else if (word == "ego")
      layout.axes = HarmonicAxes::ego;
    else
      throw refuse("has an unknown part '" + std::string(word) + "'");
  }
  validate(layout);
  return layout;
}

ListenerLayout ListenerLayout::from_file(const std::filesystem::path& path) {
  ConfigReader reader = ConfigReader::from_text(read_regular_file(path, kMaxLayoutBytes), path.string());
  std::vector<ConfigReader> maps = reader.children("microphones", kMicrophonesAbout);
  reader.finish();
  if (!reader.has("microphones")) reader.fail("microphones", "is missing; it is a list of microphones");
  if (maps.empty() || maps.size() > kMaxMicrophones)
    reader.fail("microphones", fmt::format("has {} entries instead of 1 to {}", maps.size(), kMaxMicrophones));
  std::vector<Microphone> microphones;
  std::vector<std::filesystem::path> files{path};
  for (ConfigReader& map : maps) microphones.push_back(read_microphone(map, path.parent_path(), files));
  if (const auto name = repeated_name(microphones)) reader.fail("microphones", fmt::format("have the name '{}' twice", *name));
  ListenerLayout layout = array(std::move(microphones));
  layout.files = std::move(files);
  return layout;
}

std::vector<ConfigKey> ListenerLayout::keys() {
  ConfigReader describer = ConfigReader::describer();
  std::vector<std::filesystem::path> files;
  for (ConfigReader& map : describer.children("microphones", kMicrophonesAbout)) read_microphone(map, {}, files);
  return describer.described();
}

int ListenerLayout::num_channels() const {
  switch (kind) {
    case ListenerKind::mono:
      return 1;
    case ListenerKind::binaural:
      return 2;
    case ListenerKind::ambisonics:
      return (order + 1) * (order + 1);
    case ListenerKind::array:
      return static_cast<int>(microphones.size());
  }
  return 0;
}

bool ListenerLayout::is_coincident() const {
  return kind == ListenerKind::array && std::ranges::all_of(microphones, [](const Microphone& microphone) {
           return microphone.position_m == glm::vec3(0) && microphone.omni_weight().has_value();
         });
}

std::vector<std::string> ListenerLayout::channel_names() const {
  if (kind == ListenerKind::mono) return {"mono"};
  if (kind == ListenerKind::binaural) return {"left", "right"};
  std::vector<std::string> names;
  for (int i = 0; i < num_channels(); ++i)
    names.push_back(kind == ListenerKind::ambisonics ? fmt::format("acn{}", i) : name_of(microphones[static_cast<std::size_t>(i)], i));
  return names;
}

void validate(const ListenerLayout& layout) {
  if (layout.kind == ListenerKind::ambisonics)
    require(layout.order >= 0 && layout.order <= kMaxAmbisonicOrder, "ambisonic order", layout.order,
            fmt::format("must be in [0, {}]", kMaxAmbisonicOrder));
  if (layout.kind != ListenerKind::array) return;
  require(!layout.microphones.empty() && layout.microphones.size() <= kMaxMicrophones, "microphones", layout.microphones.size(),
          "must be in [1, 256]: each is a channel");
  if (const auto name = repeated_name(layout.microphones))
    throw InputError("microphones", fmt::format("have the name '{}' twice", *name), "give each a name of its own, or none");
  for (const Microphone& microphone : layout.microphones) {
    for (int axis = 0; axis < 3; ++axis) {
      const float value = microphone.position_m[axis];
      require(std::abs(value) <= kMaxOffsetM, "position_m", value, "must be within 10 m of the listener");
    }
    const float lowpass_hz = microphone.lowpass_hz;
    require(lowpass_hz == 0 || (lowpass_hz >= kMinLowpassHz && lowpass_hz <= kMaxLowpassHz), "lowpass_hz", lowpass_hz,
            "must be 0, for none, or in [20, 20000]");
    const float length = glm::length(microphone.orientation);
    require(std::abs(length - 1.f) <= 1e-3f, "orientation length", length, "must be a unit quaternion");
  }
}

ListenerLayout read_layout(const ConfigReader& reader, const std::string& key, const std::string& value) {
  try {
    return ListenerLayout::named(value);
  } catch (const InputError& error) {
    reader.fail(key, error.what());
  }
}

}  // namespace earshot
