// SPDX-License-Identifier: Apache-2.0
#include "earshot/config.h"

#include <array>
#include <charconv>
#include <fstream>
#include <sstream>

#include "sim/acoustics/core/acoustic_config.h"
#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"

namespace earshot::api {

Settings::Value::Value(double number) {
  std::array<char, 32> digits{};
  const auto written = std::to_chars(digits.data(), digits.data() + digits.size(), number);
  text_.assign(digits.data(), written.ptr);
}

Settings::Settings(std::initializer_list<std::pair<std::string, Value>> values) {
  for (const auto& [key, value] : values) set(key, value);
}

Config Config::from_file(const std::filesystem::path& path, Settings overrides) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  if (file && std::filesystem::is_regular_file(path)) text << file.rdbuf();
  if (!file || !text) throw InputError(path.string(), "cannot be read", "name a YAML file");
  return {text.str(), path.string(), std::move(overrides)};
}

std::string acoustic_config_text(const std::string& preset, const Settings& settings) {
  AcousticConfig config = acoustic_preset(preset);
  ConfigReader reader = ConfigReader::from_text("", "settings", settings.texts());
  read(reader, config);
  reader.finish();
  validate(config);
  ConfigReader recorder = ConfigReader::recorder();
  read(recorder, config);
  return recorder.effective();
}

}  // namespace earshot::api
