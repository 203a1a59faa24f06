// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/point_cloud/xyz_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <optional>

#include "sim/base/errors.h"
#include "sim/base/text/text_match.h"
#include "sim/scene/readers/mesh_builder.h"
#include "sim/scene/readers/text_scanner.h"

namespace earshot {
namespace {

constexpr std::string_view kBlanks = " \t\v\f";

void split_at(std::string_view line, std::string_view separators, std::vector<std::string_view>& words) {
  words.clear();
  for (std::size_t begin = line.find_first_not_of(separators); begin != std::string_view::npos;
       begin = line.find_first_not_of(separators, begin)) {
    const std::size_t end = std::min(line.find_first_of(separators, begin), line.size());
    words.push_back(line.substr(begin, end - begin));
    begin = end;
  }
}

/// A comma stands between columns where blanks give fewer than three, and at the end of a word; within one, and in a line with semicolons,
/// it is a decimal comma.
void split_columns(std::string_view line, std::vector<std::string_view>& words) {
  split_at(line, " \t\v\f;", words);
  if (line.find(';') != std::string_view::npos) return;
  const bool has_commas = std::ranges::any_of(words, [](std::string_view word) { return word.ends_with(','); });
  if (has_commas || (words.size() < 3 && line.find(',') != std::string_view::npos)) split_at(line, " \t\v\f,", words);
}

class XyzParser {
 public:
  XyzParser(std::string_view bytes, const std::string& where) : lines_(bytes), where_(where) {}

  PointCloud parse() {
    while (lines_.next()) {
      std::string_view line = lines_.line();
      const std::size_t begin = line.find_first_not_of(kBlanks);
      if (begin == std::string_view::npos) continue;
      line.remove_prefix(begin);
      if (line.front() == '#' || line.starts_with("//")) continue;
      split_columns(line, words_);
      if (!words_.empty()) take_line();
      is_first_ = false;
    }
    if (declared_ && *declared_ != cloud_.positions.size())
      fail(fmt::format("declares {} points, but holds {}", *declared_, cloud_.positions.size()));
    return std::move(cloud_);
  }

 private:
  [[noreturn]] void fail(const std::string& problem) const {
    throw InputError(where_, problem, "write one point a line: x y z, in decimal numbers");
  }

  void take_line() {
    if (words_.size() == 1) {
      const auto count = parse_whole(words_[0]);
      if (!count || *count < 0) fail(fmt::format("line {} holds '{}'", lines_.number(), one_line(std::string(words_[0]))));
      require_point_count(static_cast<std::uint64_t>(*count), where_);
      declared_ = declared_.value_or(0) + static_cast<std::uint64_t>(*count);
      return;
    }
    if (is_first_ && !parse_decimal(words_[0])) return take_names();
    glm::dvec3 position;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (columns_[axis] >= words_.size()) fail(fmt::format("line {} has {} columns", lines_.number(), words_.size()));
      const auto value = parse_decimal(words_[columns_[axis]]);
      if (!value) fail(fmt::format("line {}: '{}' is not a number", lines_.number(), one_line(std::string(words_[columns_[axis]]))));
      position[static_cast<glm::length_t>(axis)] = *value;
    }
    if (cloud_.positions.size() == kMaxPoints) require_point_count(kMaxPoints + 1, where_);
    cloud_.positions.push_back(position);
  }

  void take_names() {
    constexpr std::array<std::string_view, 3> names{"x", "y", "z"};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto found = std::ranges::find_if(words_, [&](std::string_view word) {
        if (word.size() >= 2 && word.front() == '"' && word.back() == '"') word = word.substr(1, word.size() - 2);
        return fold_case(word) == names[axis];
      });
      if (found == words_.end()) fail(fmt::format("line {} names no columns x, y and z", lines_.number()));
      columns_[axis] = static_cast<std::size_t>(found - words_.begin());
    }
  }

  LineScanner lines_;
  const std::string& where_;
  PointCloud cloud_;
  std::vector<std::string_view> words_;
  std::array<std::size_t, 3> columns_{0, 1, 2};
  std::optional<std::uint64_t> declared_;
  bool is_first_ = true;
};

}  // namespace

PointCloud parse_xyz(std::string_view bytes, const std::string& where) { return XyzParser(bytes, where).parse(); }

}  // namespace earshot
