// SPDX-License-Identifier: Apache-2.0
#include "envs/episodes/name_ranges.h"

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <filesystem>
#include <set>

#include "sim/base/errors.h"

namespace earshot {
namespace {

/// Position and length of "A..B" with digits on both sides, or npos.
struct Range {
  std::size_t begin = std::string::npos, length = 0;
  std::uint64_t first = 0, last = 0;
};

Range find_range(const std::string& text) {
  const auto digit = [&](std::size_t i) { return i < text.size() && text[i] >= '0' && text[i] <= '9'; };
  for (std::size_t dots = text.find(".."); dots != std::string::npos; dots = text.find("..", dots + 1)) {
    std::size_t begin = dots, end = dots + 2;
    while (begin > 0 && digit(begin - 1)) --begin;
    while (digit(end)) ++end;
    if (begin == dots || end == dots + 2) continue;
    Range range{begin, end - begin, 0, 0};
    const bool parsed = std::from_chars(text.data() + begin, text.data() + dots, range.first).ec == std::errc{} &&
                        std::from_chars(text.data() + dots + 2, text.data() + end, range.last).ec == std::errc{};
    if (!parsed || range.last < range.first || range.last - range.first >= 100000)
      throw InputError(text, "is not a range of at most 100,000 numbers", "write A..B with A <= B");
    return range;
  }
  return {};
}

}  // namespace

std::vector<std::string> expand_range(const std::string& text) {
  const Range range = find_range(text);
  if (range.begin == std::string::npos) return {text};
  std::vector<std::string> all;
  for (std::uint64_t value = range.first; value <= range.last; ++value)
    all.push_back(text.substr(0, range.begin) + std::to_string(value) + text.substr(range.begin + range.length));
  return all;
}

std::vector<std::string> expand_ranges(const std::vector<std::string>& texts) {
  std::vector<std::string> all;
  for (const std::string& text : texts)
    for (std::string& name : expand_range(text)) all.push_back(std::move(name));
  return all;
}

std::vector<std::string> expand_sounds(const std::vector<std::string>& sounds) {
  static const std::set<std::string> endings{".wav", ".flac", ".ogg", ".oga"};
  std::vector<std::string> all;
  for (const auto& sound : sounds) {
    if (!std::filesystem::is_directory(sound)) {
      const auto expanded = expand_range(sound);
      all.insert(all.end(), expanded.begin(), expanded.end());
      continue;
    }
    std::vector<std::string> files;
    for (const auto& entry : std::filesystem::directory_iterator(sound))
      if (entry.is_regular_file() && endings.contains(entry.path().extension().string())) files.push_back(entry.path().string());
    if (files.empty()) throw InputError(sound, "contains no .wav, .flac, .ogg or .oga file", "use a folder with sound files");
    std::ranges::sort(files);
    all.insert(all.end(), files.begin(), files.end());
  }
  return all;
}

}  // namespace earshot
