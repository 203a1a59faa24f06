// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

namespace earshot {

/// Goes through the lines of a text.  A line ends at "\n", "\r\n" or "\r".
class LineScanner {
 public:
  explicit LineScanner(std::string_view bytes) : bytes_(bytes) {}

  /// To the next line; false at the end of the text.
  bool next();
  [[nodiscard]] std::string_view line() const { return line_; }  ///< without its end
  [[nodiscard]] std::size_t number() const { return number_; }   ///< from 1
  /// False for a last line that the text ends in without a line break: a file that was cut off ends so, and so do some whole ones.
  [[nodiscard]] bool has_break() const { return has_break_; }
  /// Where the next line begins.
  [[nodiscard]] std::size_t offset() const { return offset_; }

 private:
  std::string_view bytes_, line_;
  std::size_t offset_ = 0, number_ = 0;
  bool has_break_ = true;
};

/// Blanks of a line, a carriage return among them.
inline constexpr std::string_view line_blanks = " \t\r\v\f";

/// Takes the first word off the front of `line`; empty if only blanks are left.
std::string_view take_word(std::string_view& line);
/// All words of a line.  `words` is overwritten.
void split_words(std::string_view line, std::vector<std::string_view>& words);
/// Without blanks at both ends.
std::string_view trimmed(std::string_view text);

/// A decimal number, whatever the locale; some exporters write a comma for the point.  May be infinite or NaN where the text says so.
/// nullopt for anything else.
std::optional<double> parse_decimal(std::string_view word);
/// A whole number with an optional sign.
std::optional<std::int64_t> parse_whole(std::string_view word);

}  // namespace earshot
