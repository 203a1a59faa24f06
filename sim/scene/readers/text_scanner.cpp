// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/readers/text_scanner.h"

#include <algorithm>
#include <charconv>
#include <limits>
#include <string>

namespace earshot {

bool LineScanner::next() {
  if (offset_ >= bytes_.size()) return false;
  const std::size_t end = bytes_.find_first_of("\r\n", offset_);
  has_break_ = end != std::string_view::npos;
  line_ = bytes_.substr(offset_, has_break_ ? end - offset_ : end);
  offset_ = has_break_ ? end + 1 : bytes_.size();
  if (has_break_ && bytes_[end] == '\r' && offset_ < bytes_.size() && bytes_[offset_] == '\n') ++offset_;
  ++number_;
  return true;
}

std::string_view take_word(std::string_view& line) {
  const std::size_t begin = line.find_first_not_of(line_blanks);
  if (begin == std::string_view::npos) return line = {};
  const std::size_t end = std::min(line.find_first_of(line_blanks, begin), line.size());
  const std::string_view word = line.substr(begin, end - begin);
  line.remove_prefix(end);
  return word;
}

void split_words(std::string_view line, std::vector<std::string_view>& words) {
  words.clear();
  for (std::string_view word = take_word(line); !word.empty(); word = take_word(line)) words.push_back(word);
}

std::string_view trimmed(std::string_view text) {
  const std::size_t begin = text.find_first_not_of(line_blanks);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(line_blanks) + 1 - begin);
}

std::optional<double> parse_decimal(std::string_view word) {
  if (word.starts_with('+')) word.remove_prefix(1);
  if (word.starts_with('+')) return std::nullopt;
  std::string with_point;
  if (const std::size_t comma = word.find(','); comma != std::string_view::npos && word.find('.') == std::string_view::npos) {
    with_point = word;
    with_point[comma] = '.';
    word = with_point;
  }
  double value = 0;
  const auto [stop, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (stop != word.data() + word.size() || word.empty()) return std::nullopt;
  if (error == std::errc::result_out_of_range) {  // from_chars leaves the value
    const std::size_t exponent = word.find_first_of("eE");
    const bool is_tiny = exponent != std::string_view::npos && word.substr(exponent + 1).starts_with('-');
    return is_tiny ? 0 : std::numeric_limits<double>::infinity();
  }
  if (error != std::errc()) return std::nullopt;
  return value;
}

std::optional<std::int64_t> parse_whole(std::string_view word) {
  if (word.starts_with('+')) {
    word.remove_prefix(1);
    if (word.starts_with('-')) return std::nullopt;
  }
  std::int64_t value = 0;
  const auto [stop, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc() || stop != word.data() + word.size() || word.empty()) return std::nullopt;
  return value;
}

}  // namespace earshot
