// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "datasets/rir_corpus.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"

namespace earshot::corpus_cases {

/// Three empty rooms, two sources with three listeners each, a second of processor time.
inline RirCorpusConfig tiny() {
  RirCorpusConfig config;
  config.seed = 5;
  config.shoeboxes.count = 3;
  config.shoeboxes.min_size_m = {3, 2.4f, 3};
  config.shoeboxes.max_size_m = {5, 3, 5};
  config.sources_per_room = 2;
  config.listeners_per_source = 3;
  config.rooms_per_folder = 2;
  config.acoustics.rir_length_s = 0.1f;
  config.acoustics.rays = 16;
  return config;
}

/// Names and bytes of all files below a folder.
inline std::map<std::string, std::string> tree(const std::filesystem::path& folder) {
  std::map<std::string, std::string> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder))
    if (entry.is_regular_file()) files[std::filesystem::relative(entry.path(), folder).string()] = read_file(entry.path());
  return files;
}

/// Only the names that differ, so that a failure is readable.
inline std::vector<std::string> differences(const std::map<std::string, std::string>& a, const std::map<std::string, std::string>& b) {
  std::vector<std::string> names;
  for (const auto& [name, bytes] : a)
    if (!b.contains(name) || b.at(name) != bytes) names.push_back(name);
  for (const auto& [name, bytes] : b)
    if (!a.contains(name)) names.push_back(name);
  return names;
}

inline std::vector<nlohmann::json> lines_of(const std::filesystem::path& file) {
  std::vector<nlohmann::json> lines;
  const std::string text = read_file(file);
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = text.find('\n', begin);
    lines.push_back(parse_json(text.substr(begin, end - begin)));
    begin = end + 1;
  }
  return lines;
}

/// A 32-bit float WAV by its chunks alone (Microsoft and IBM 1991, RIFF WAVE), without the library that wrote it: [channel][frame].
struct FloatWav {
  int rate_hz = 0;
  std::vector<std::vector<float>> channels;
};
inline FloatWav read_float_wav(const std::string& bytes) {
  const auto number = [&](std::size_t at, std::size_t size) {
    std::uint32_t value = 0;
    std::memcpy(&value, bytes.data() + at, size);
    return value;
  };
  FloatWav wav;
  if (bytes.substr(0, 4) != "RIFF" || bytes.substr(8, 4) != "WAVE") return wav;
  std::size_t width = 0;
  for (std::size_t at = 12; at + 8 <= bytes.size();) {
    const std::string chunk = bytes.substr(at, 4);
    const std::size_t size = number(at + 4, 4);
    if (chunk == "fmt ") {
      if (number(at + 8, 2) != 3 || number(at + 22, 2) != 32) return wav;  // IEEE float of 32 bits
      width = number(at + 10, 2);
      wav.rate_hz = static_cast<int>(number(at + 12, 4));
    }
    if (chunk == "data" && width > 0) {
      wav.channels.resize(width);
      for (std::size_t sample = 0; sample < size / 4; ++sample) {
        float value = 0;
        std::memcpy(&value, bytes.data() + at + 8 + 4 * sample, 4);
        wav.channels[sample % width].push_back(value);
      }
    }
    at += 8 + size + size % 2;
  }
  return wav;
}

}  // namespace earshot::corpus_cases
