// SPDX-License-Identifier: Apache-2.0
#include "evaluation/results/sensed_config.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <string_view>
#include <vector>

#include "sim/audio/head/layout_file.h"
#include "sim/base/control_characters.h"
#include "sim/base/errors.h"
#include "sim/base/regular_file.h"
#include "sim/base/sha256.h"
#include "sim/base/text/listed.h"
#include "trainer/run/effective_config.h"

namespace earshot {
namespace {

constexpr const char* kHead = "hrtf";
/// Responses of a head with thousands of directions take some tens of MB.
constexpr std::size_t kMaxHeadBytes = std::size_t{1} << 30;
constexpr const char* kChannels = "observation.channels";
constexpr std::size_t kMaxMicrophoneBytes = std::size_t{64} << 20;

/// "array:SHA256,SHA256": the file of microphones, then those of their patterns, in order.
std::string channels_by_content(const ObservationSpec& spec) {
  std::vector<std::string> hashes;
  for (const auto& file : spec.layout().files) hashes.push_back(sha256_hex(read_regular_file(file, kMaxMicrophoneBytes)));
  return spec.channels.substr(0, spec.channels.find(':') + 1) + listed(hashes, ",");
}

}  // namespace

bool is_local_key(const std::string& key) {
  constexpr std::array<std::string_view, 14> local{
      "threads",     "prefetch",       "acoustics.threads", "acoustics.preset", "scene_cache_gb", "field_store", "field_store_gb",
      "scene_store", "scene_store_gb", "quarantine_dir",    "scene_root",       "sound_root",     "order",       "autoreset"};
  return key == "observation.egl_device" || std::ranges::find(local, key) != local.end();
}

SensedConfig sensed_config(const EnvConfig& env) {
  SensedConfig senses = flat_config(config_text(env));
  std::erase_if(senses, [](const auto& entry) { return is_local_key(entry.first); });
  if (env.observation.has_ears()) senses.erase(kChannels);  // goes without saying, as in the hashes of benchmarks
  if (names_file(env.observation.channels)) senses[kChannels] = channels_by_content(env.observation);
  if (!env.hrtf.empty()) senses[kHead] = sha256_hex(read_regular_file(env.hrtf, kMaxHeadBytes));
  return senses;
}

void refuse_channels_of_file(const std::string& channels, const std::string& where) {
  if (!names_file(channels)) return;
  throw InputError(where, fmt::format("has env.observation.channels = {}, but no file is opened for agents of others", printable(channels)),
                   "use channels that need no file, such as binaural or ambisonic:1");
}

EnvConfig env_of_senses(const SensedConfig& senses, const std::string& where) {
  std::vector<std::string> keys;
  for (const auto& [key, value] : senses)
    if (key != kHead) keys.push_back(key + "=" + value);
  const std::string part = where + " (its senses)";
  ConfigReader reader = ConfigReader::from_text("", part, keys);
  EnvConfig env;
  read(reader, env);
  reader.finish();
  refuse_channels_of_file(env.observation.channels, part);
  return env;
}

}  // namespace earshot
