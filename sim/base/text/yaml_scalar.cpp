// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/yaml_scalar.h"

#include <fmt/format.h>

#include <charconv>
#include <optional>
#include <vector>

namespace earshot {
namespace {

constexpr std::string_view kQuoteIt = "quote the value";

bool is_one_of(char c, std::string_view set) { return c != '\0' && set.find(c) != std::string_view::npos; }

/// The text that `breaks` line ends within a scalar stand for.
std::string fold(std::size_t breaks) { return breaks == 1 ? " " : std::string(breaks - 1, '\n'); }

/// Skips line ends and the indentation of the next line; returns the number of line ends.
std::size_t skip_breaks(YamlCursor& cursor, bool is_quoted) {
  std::size_t breaks = 0;
  for (;; cursor.advance()) {
    while (cursor.peek() == '\n') {
      cursor.next_line();
      ++breaks;
    }
    if (cursor.peek() != ' ' && !(is_quoted && cursor.peek() == '\t')) return breaks;
  }
}

std::string utf8_of(char32_t c) {
  std::string text;
  const auto put = [&](char32_t byte) { text += static_cast<char>(static_cast<unsigned char>(byte)); };
  if (c < 0x80) {
    put(c);
  } else if (c < 0x800) {
    put(0xC0 | (c >> 6));
    put(0x80 | (c & 0x3F));
  } else if (c < 0x10000) {
    put(0xE0 | (c >> 12));
    put(0x80 | ((c >> 6) & 0x3F));
    put(0x80 | (c & 0x3F));
  } else {
    put(0xF0 | (c >> 18));
    put(0x80 | ((c >> 12) & 0x3F));
    put(0x80 | ((c >> 6) & 0x3F));
    put(0x80 | (c & 0x3F));
  }
  return text;
}

/// The character of an escape whose backslash was read; the cursor is left behind it.
std::string read_escape(YamlCursor& cursor) {
  const char letter = cursor.peek();
  cursor.advance();
  switch (letter) {
    case 't':
    case '\t':
      return "\t";
    case 'n':
      return "\n";
    case 'r':
      return "\r";
    case '_':
      return "\u00A0";
    case ' ':
    case '"':
    case '/':
    case '\\':
      return std::string(1, letter);
    default:
      break;
  }
  const std::size_t digits = letter == 'x' ? 2 : letter == 'u' ? 4 : letter == 'U' ? 8 : 0;
  std::uint32_t character = 0;
  const std::string_view code = cursor.text().substr(cursor.at()).substr(0, digits);
  const auto [end, error] = std::from_chars(code.data(), code.data() + code.size(), character, 16);
  const bool is_code = digits > 0 && code.size() == digits && error == std::errc() && end == code.data() + code.size();
  if (!is_code || !is_text_character(character))
    cursor.fail("has an escape in quotes that stands for no character of a text",
                "use \\t, \\n, \\r, \\\", \\\\ or \\u and four digits; in single quotes a backslash is an ordinary character");
  cursor.advance(digits);
  return utf8_of(character);
}

/// Joins the lines of a quoted scalar.
std::string fold_quoted(YamlCursor& cursor, const YamlPlace& place, std::uint32_t first_line) {
  const std::size_t breaks = skip_breaks(cursor, true);
  const bool is_marker = cursor.is_marker("---") || cursor.is_marker("...");
  if (place.is_key || cursor.is_at_end() || is_marker || (!place.in_flow && cursor.column() <= place.parent))
    cursor.fail(first_line, "has a quote that is not closed", "close it in the same line, or indent the lines that belong to it");
  return fold(breaks);
}

/// Style, indentation and end of the lines behind `|` or `>`.
struct BlockStyle {
  bool is_folded = false;
  char chomping = ' ';   ///< '-': no line end behind the last line; '+': all of them
  int indentation = -1;  ///< column of its lines; negative: that of the first one
};

BlockStyle read_block_style(YamlCursor& cursor, int parent) {
  BlockStyle style{.is_folded = cursor.peek() == '>'};
  cursor.advance();
  for (int i = 0; i < 2; ++i) {
    const char c = cursor.peek();
    if ((c == '+' || c == '-') && style.chomping == ' ')
      style.chomping = c;
    else if (c >= '1' && c <= '9' && style.indentation < 0)
      style.indentation = std::max(parent, 0) + (c - '0');
    else
      break;
    cursor.advance();
  }
  cursor.expect_line_end();
  return style;
}

/// One line of a block text: without its indentation, and without its line end.
std::string_view take_line(YamlCursor& cursor) {
  const std::size_t begin = cursor.at();
  while (!cursor.is_line_end()) cursor.advance();
  return cursor.since(begin);
}

std::string joined(const std::vector<std::string>& lines, const BlockStyle& style) {
  std::string text;
  std::size_t breaks = 0;
  bool is_first = true;
  for (const std::string& line : lines) {
    if (!line.empty()) {
      text += is_first || !style.is_folded ? std::string(breaks, '\n') : fold(breaks);
      text += line;
      breaks = 0;
      is_first = false;
    }
    ++breaks;
  }
  return text;
}

}  // namespace

bool is_text_character(char32_t c) {
  if (c < 0x20) return c == '\t' || c == '\n' || c == '\r';
  if (c >= 0x7F && c < 0xA0) return false;
  if (c == 0x2028 || c == 0x2029 || c == 0xFEFF || c == 0xFFFE || c == 0xFFFF) return false;
  return c <= 0x10FFFF && (c < 0xD800 || c > 0xDFFF);
}

void check_plain_start(const YamlCursor& cursor, bool in_flow) {
  const char c = cursor.peek();
  if (c == '!') cursor.fail("has a tag (!), which gives a value another type", "leave it out: each key has one type; quote a text");
  if (c == '?' && (cursor.is_blank(1) || in_flow)) cursor.fail("has a key behind '?'", "write 'key: value'");
  if (is_one_of(c, ",[]{}#&*|>'\"%@`") || c == '\0')
    cursor.fail(fmt::format("has a value or key that begins with '{}'", c == '\0' ? ' ' : c), kQuoteIt);
  if ((c == '-' || c == ':') && (cursor.is_blank(1) || (in_flow && (c == ':' || is_one_of(cursor.peek(1), ",[]{}")))))
    cursor.fail(fmt::format("has a '{}' where a value or key begins", c),
                c == '-' ? "begin a list in the line behind its key, or write [a, b]" : "write 'key: value'");
}

std::string read_plain(YamlCursor& cursor, const YamlPlace& place) {
  check_plain_start(cursor, place.in_flow);
  std::string text;
  for (;;) {
    const std::size_t begin = cursor.at();
    std::size_t length = 0;
    for (; !cursor.is_line_end(); cursor.advance()) {
      const char c = cursor.peek();
      if (c == '\t') cursor.fail("has a tab outside of quotes", "separate with spaces, or quote the text");
      if (c == ':' && cursor.is_blank(1)) break;
      if (c == '#' && cursor.at() > begin && cursor.previous() == ' ') break;
      if (place.in_flow && c == ':' && is_one_of(cursor.peek(1), ",[]{}"))
        cursor.fail("has a ':' before a bracket or comma", "write a space behind the ':' of a key, or quote the text");
      if (place.in_flow && c == '?' && cursor.is_blank(1)) cursor.fail("has a '?' within [ ] or { }", kQuoteIt);
      if (place.in_flow && is_one_of(c, ",[]{}")) break;
      if (c != ' ') length = cursor.at() + 1 - begin;
    }
    text += cursor.text().substr(begin, length);
    if (!cursor.is_line_end() || place.is_key) return text;
    YamlCursor next = cursor;
    const std::size_t breaks = skip_breaks(next, false);
    const bool is_out = !place.in_flow && next.column() <= place.parent;
    if (next.is_at_end() || is_out || next.peek() == '#' || next.is_marker("---") || next.is_marker("...")) return text;
    if (place.in_flow && is_one_of(next.peek(), ",]}")) return text;
    if (next.peek() == '\t') next.skip_spaces();
    if (!place.in_flow && next.find_key_end() != std::string_view::npos)
      next.fail("is indented like a part of the value above", "begin it in the column of the key that it belongs beside");
    if ((next.peek() == '-' || next.peek() == ':') && next.is_blank(1))
      next.fail("is indented like a part of the value above", "quote the value, or take one of the two away");
    check_plain_start(next, place.in_flow);
    text += fold(breaks);
    cursor = next;
  }
}

std::string read_quoted(YamlCursor& cursor, const YamlPlace& place) {
  const char quote = cursor.peek();
  const std::uint32_t first_line = cursor.line();
  cursor.advance();
  std::string text;
  std::size_t kept = 0;  // bytes of the text that stay before a line end, which removes blanks
  for (;;) {
    const char c = cursor.peek();
    if (cursor.is_at_end()) cursor.fail(first_line, "has a quote that is not closed", "close it in the same line");
    if (c == '\n') {
      text.resize(kept);
      text += fold_quoted(cursor, place, first_line);
      kept = text.size();
      continue;
    }
    cursor.advance();
    if (c == quote && (quote == '"' || cursor.peek() != '\'')) return text;
    if (c == '\\' && quote == '"' && cursor.peek() == '\n') {
      const std::string folded = fold_quoted(cursor, place, first_line);
      if (folded != " ") text += folded;  // the first line end is escaped
    } else if (c == '\\' && quote == '"') {
      text += read_escape(cursor);
    } else {
      if (c == quote) cursor.advance();  // '' in single quotes
      text += c;
      if (c == ' ' || c == '\t') continue;
    }
    kept = text.size();
  }
}

std::string read_block_text(YamlCursor& cursor, int parent) {
  BlockStyle style = read_block_style(cursor, parent);
  std::vector<std::string> lines;
  bool has_line_end = true;  // behind the last line
  int longest_blank = 0;
  while (!cursor.is_at_end()) {
    YamlCursor line = cursor;
    line.next_line();
    while (line.peek() == ' ' && (style.indentation < 0 || line.column() < style.indentation)) line.advance();
    if (line.peek() == '\n' || line.is_at_end()) {
      if (line.is_at_end() && line.column() == 0) break;
      longest_blank = std::max(longest_blank, line.column());
      has_line_end = !line.is_at_end();
      lines.emplace_back();
      cursor = line;
      continue;
    }
    if (style.indentation < 0 && line.column() > parent && line.column() > 0) {
      style.indentation = line.column();
      if (longest_blank > style.indentation) line.fail("is indented less than a blank line above it", "empty the blank line");
    }
    if (style.indentation < 0 || line.column() < style.indentation) break;
    if (line.peek() == '\t' || (style.is_folded && line.peek() == ' '))
      line.fail("is indented further than the text above it", "use '|' for a text whose lines are kept, and spaces");
    lines.emplace_back(take_line(line));
    has_line_end = !line.is_at_end();
    cursor = line;
  }
  std::size_t breaks = 0;
  while (breaks < lines.size() && lines[lines.size() - 1 - breaks].empty()) ++breaks;
  const bool has_text = breaks < lines.size();
  std::string text = joined(lines, style);
  const std::size_t ends = breaks + (has_text ? 1 : 0) - (has_line_end || lines.empty() ? 0 : 1);
  if (style.chomping == '+') text += std::string(ends, '\n');
  if (style.chomping == ' ' && has_text && ends > 0) text += '\n';
  return text;
}

}  // namespace earshot
