// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace earshot {

/// Name of a YAML text in messages.
struct YamlSource {
  std::string where;
  bool has_lines = true;  ///< a file; of a value from the command line no line is named
};

/// A place in a YAML text whose lines end with a line feed.  Only spaces separate: a tab outside of quotes is an error.
class YamlCursor {
 public:
  /// text: outlives the cursor, holds no zero byte.
  YamlCursor(std::string_view text, const YamlSource& source) : text_(text), source_(&source) {}

  /// The byte that lies `ahead`; zero behind the end.
  [[nodiscard]] char peek(std::size_t ahead = 0) const { return at_ + ahead < text_.size() ? text_[at_ + ahead] : '\0'; }
  /// The byte before; a line feed at the beginning.
  [[nodiscard]] char previous() const { return at_ == 0 ? '\n' : text_[at_ - 1]; }
  [[nodiscard]] bool is_at_end() const { return at_ >= text_.size(); }
  /// Whether a space, a line end or the end of the text lies `ahead`.
  [[nodiscard]] bool is_blank(std::size_t ahead = 0) const {
    const char c = peek(ahead);
    return c == ' ' || c == '\n' || c == '\0' || c == '\t';
  }
  [[nodiscard]] bool is_line_end() const { return peek() == '\n' || is_at_end(); }
  [[nodiscard]] std::uint32_t line() const { return line_; }
  /// Bytes before the place in its line.
  [[nodiscard]] int column() const { return static_cast<int>(at_ - line_start_); }
  [[nodiscard]] std::size_t at() const { return at_; }
  [[nodiscard]] std::string_view text() const { return text_; }
  [[nodiscard]] std::string_view since(std::size_t begin) const { return text_.substr(begin, at_ - begin); }
  /// Whether `marker`, "---" or "...", stands alone at the beginning of a line.
  [[nodiscard]] bool is_marker(std::string_view marker) const {
    return column() == 0 && text_.substr(at_).starts_with(marker) && is_blank(marker.size());
  }

  /// Goes on within the line.
  void advance(std::size_t bytes = 1) { at_ += bytes; }
  void next_line() {
    line_start_ = ++at_;
    ++line_;
  }
  void skip_spaces();
  /// Skips spaces, line ends and comments.
  void skip_to_token();
  /// Skips spaces and a comment up to the line end, which has to follow.
  void expect_line_end();
  /// Of a key that begins here: where the colon behind it lies, in the same line; npos where no key does.
  [[nodiscard]] std::size_t find_key_end() const;

  /// Throws InputError "where:line: problem; remedy".
  [[noreturn]] void fail(std::string_view problem, std::string_view remedy) const { fail(line_, problem, remedy); }
  [[noreturn]] void fail(std::uint32_t line, std::string_view problem, std::string_view remedy) const;
  [[nodiscard]] const YamlSource& source() const { return *source_; }

 private:
  void skip_comment();

  std::string_view text_;
  const YamlSource* source_;
  std::size_t at_ = 0, line_start_ = 0;
  std::uint32_t line_ = 1;
};

}  // namespace earshot
