// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/yaml_cursor.h"

#include "sim/base/errors.h"

namespace earshot {

void YamlCursor::skip_spaces() {
  while (peek() == ' ') advance();
  if (peek() == '\t') fail("has a tab outside of quotes", "indent and separate with spaces");
}

void YamlCursor::skip_comment() {
  if (peek() != '#') return;
  if (previous() != ' ' && previous() != '\n') fail("has a '#' directly behind a value", "write a space before a comment");
  while (!is_line_end()) advance();
}

void YamlCursor::skip_to_token() {
  for (;;) {
    skip_spaces();
    skip_comment();
    if (peek() != '\n') return;
    next_line();
  }
}

void YamlCursor::expect_line_end() {
  skip_spaces();
  skip_comment();
  if (is_line_end()) return;
  if (peek() == ':') fail("has a second ':' in the line of a key", "put a section on lines of its own, or quote a text that contains ': '");
  fail("has text behind the end of a value", "quote the whole value, or separate values with commas in [ ]");
}

std::size_t YamlCursor::find_key_end() const {
  std::size_t i = at_;
  const auto byte = [&](std::size_t place) { return place < text_.size() ? text_[place] : '\n'; };
  const auto ends_key = [&](std::size_t place) {
    return byte(place) == ':' && (byte(place + 1) == ' ' || byte(place + 1) == '\n' || byte(place + 1) == '\t');
  };
  if (const char quote = byte(i); quote == '"' || quote == '\'') {
    for (++i; byte(i) != quote || (quote == '\'' && byte(i + 1) == quote); ++i) {
      if (byte(i) == '\n') return std::string_view::npos;
      if (byte(i) == (quote == '"' ? '\\' : quote) && byte(i + 1) != '\n') ++i;
    }
    for (++i; byte(i) == ' '; ++i) {
    }
    return ends_key(i) ? i : std::string_view::npos;
  }
  for (; byte(i) != '\n'; ++i) {
    if (ends_key(i)) return i;
    if (byte(i) == '#' && i > at_ && byte(i - 1) == ' ') break;
  }
  return std::string_view::npos;
}

void YamlCursor::fail(std::uint32_t line, std::string_view problem, std::string_view remedy) const {
  throw InputError(source_->has_lines ? source_->where + ":" + std::to_string(line) : source_->where, problem, remedy);
}

}  // namespace earshot
