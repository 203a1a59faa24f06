// SPDX-License-Identifier: Apache-2.0
#include "evaluation/results/sensed_config.h"

#include <algorithm>
#include <array>
#include <string_view>
#include <vector>

#include "sim/base/regular_file.h"
#include "sim/base/sha256.h"
#include "trainer/run/effective_config.h"

namespace earshot {
namespace {

constexpr const char* kHead = "hrtf";
/// Responses of a head with thousands of directions take some tens of MB.
constexpr std::size_t kMaxHeadBytes = std::size_t{1} << 30;

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
  if (env.observation.has_ears()) senses.erase("observation.channels");  // goes without saying, as in the hashes of benchmarks
  if (!env.hrtf.empty()) senses[kHead] = sha256_hex(read_regular_file(env.hrtf, kMaxHeadBytes));
  return senses;
}

EnvConfig env_of_senses(const SensedConfig& senses, const std::string& where) {
  std::vector<std::string> keys;
  for (const auto& [key, value] : senses)
    if (key != kHead) keys.push_back(key + "=" + value);
  ConfigReader reader = ConfigReader::from_text("", where + " (its senses)", keys);
  EnvConfig env;
  read(reader, env);
  reader.finish();
  return env;
}

}  // namespace earshot
