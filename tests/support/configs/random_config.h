// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "sim/base/random.h"

namespace earshot {

/// Draws in order from one stream.
class Draws {
 public:
  Draws(std::uint64_t seed, std::uint32_t round) : random_(seed, Purpose::test, round) {}
  std::uint32_t below(std::size_t count) { return random_.below(static_cast<std::uint32_t>(count), next_++); }
  bool one_in(std::uint32_t count) { return below(count) == 0; }
  template <class List>
  const auto& of(const List& list) {
    return list[below(std::size(list))];
  }

 private:
  RandomStream random_;
  std::uint32_t next_ = 0;
};

/// Writes random configs in the styles that people and programs write.
class RandomConfig {
 public:
  explicit RandomConfig(Draws& draws) : draws_(draws) {}

  std::string text() {
    std::string text = draws_.one_in(20) ? "\xEF\xBB\xBF" : "";
    if (draws_.one_in(10)) text += "# a comment: with a colon\n";
    if (draws_.one_in(15)) text += "---\n";
    text += map(0, 0);
    if (draws_.one_in(25)) text += "...\n";
    if (draws_.one_in(20)) text.pop_back();
    if (!draws_.one_in(15)) return text;
    std::string lines;
    for (const char c : text) lines += c == '\n' ? std::string("\r\n") : std::string(1, c);
    return lines;
  }

 private:
  // Words between two spaces, written without quotes where that is possible.
  static constexpr std::string_view kPlain =
      "1 -2 010 0x10 3e6 1e-05 .5 .inf true off null ~ word house:7,rooms=3 a:b x#y -dash 8..9 a,b ?q p? :x http://e.org/a?b=c 1_000 50% "
      "a]b << "
      "it's \"x\"y = * 1:30 caf\u00e9 \u6f22\u5b57 a&b x*y -. !!float_1e3 !!int_7 two_words a_&_b x_#_y a_-_b";
  static constexpr std::array<std::string_view, 10> kInQuotes = {
      "", "a: b", "# no comment", " blank at both ends ", "tab\\t", "new\\nline", "null", "- x", "[a]", "\\u00e9\\x41"};
  static constexpr std::string_view kWords = "env task seed max_steps acoustics rays data train file wall* with_space 0";

  /// One of the words; underscores are spaces.
  std::string word_of(std::string_view words) {
    const std::size_t count = 1 + static_cast<std::size_t>(std::ranges::count(words, ' '));
    for (std::size_t skip = draws_.below(count); skip > 0; --skip) words.remove_prefix(words.find(' ') + 1);
    std::string word(words.substr(0, words.find(' ')));
    std::ranges::replace(word, '_', ' ');
    return word;
  }

  std::string key() {
    std::string name = word_of(kWords);
    if (!draws_.one_in(60)) name += std::to_string(++keys_);
    if (name[0] == '*' || draws_.one_in(12)) return (draws_.one_in(2) ? "'" + name + "'" : "\"" + name + "\"");
    return name;
  }

  std::string scalar(bool in_flow) {
    if (!anchors_.empty() && draws_.one_in(12)) return "*" + std::string(draws_.of(anchors_)) + (in_flow && draws_.one_in(4) ? " " : "");
    std::string anchor;
    if (draws_.one_in(20)) {
      anchors_.push_back("a" + std::to_string(++keys_));
      anchor = "&" + anchors_.back() + " ";
    }
    if (draws_.one_in(4)) {
      const std::string text(draws_.of(kInQuotes));
      return anchor + (draws_.one_in(2) ? "\"" + text + "\"" : "'" + text + "'");
    }
    const std::string text = word_of(kPlain);
    const bool needs_quotes = text == "*" || (in_flow && text.find_first_of(",]?:") != std::string::npos);
    return anchor + (needs_quotes && !draws_.one_in(10) ? "'" + (text == "it's" ? "it''s" : text) + "'" : text);
  }

  std::string end_of_line() {
    std::string end = draws_.one_in(12) ? "  # said: why" : draws_.one_in(25) ? " " : "";
    end += "\n";
    if (draws_.one_in(15)) end += "\n";
    if (draws_.one_in(30)) end += "   # a line\n";
    return end;
  }

  /// Between the parts of what stands in brackets.
  std::string gap() { return draws_.one_in(12) ? "\n   " : draws_.one_in(40) ? " # in brackets\n  " : draws_.one_in(3) ? "" : " "; }

  std::string flow(int depth) {
    if (depth > 2 || !draws_.one_in(3)) return scalar(true);
    const bool is_map = draws_.one_in(2);
    std::string text = is_map ? "{" : "[";
    const std::uint32_t count = draws_.below(4);
    for (std::uint32_t i = 0; i < count; ++i) {
      text += gap();
      if (is_map) text += key() + ": ";
      text += flow(depth + 1) + (i + 1 < count || draws_.one_in(8) ? "," : "");
    }
    return text + gap() + (is_map ? "}" : "]");
  }

  std::string indented(int column) { return std::string(static_cast<std::size_t>(column), ' '); }

  /// Behind "key:" or "-" at `column`: the rest of the line, and the lines below.
  std::string value(int column, int depth, bool is_item) {
    const std::uint32_t kind = draws_.below(depth > 3 ? 12 : 20);
    if (kind < 9) return " " + scalar(false) + end_of_line();
    if (kind == 9) return " [" + gap() + flow(0) + "]" + end_of_line();
    if (kind == 10) return end_of_line();
    if (kind == 11) return lines_of_text(column);
    const int step = 1 + static_cast<int>(draws_.below(4));
    std::string anchor;
    if (draws_.one_in(15)) {
      anchors_.push_back("m" + std::to_string(++keys_));
      anchor = " &" + anchors_.back();
    }
    if (kind < 16) return anchor + end_of_line() + map(column + step, depth + 1);
    if (is_item && kind == 16) return "   " + map(column + 4, depth + 1).substr(static_cast<std::size_t>(column) + 4);
    return anchor + end_of_line() + list(is_item || draws_.one_in(2) ? column + step : column, depth + 1);
  }

  std::string lines_of_text(int column) {
    const std::string pad = "\n" + indented(column + 2);
    switch (draws_.below(5)) {
      case 0:
        return " first line" + pad + "second line\n" + pad + "third" + end_of_line();
      case 1:
        return " \"first \\" + pad + "second  " + pad + "third\"" + end_of_line();
      case 2:
        return " 'first" + pad + pad + "it''s  second'" + end_of_line();
      case 3:
        return std::string(" |") + (draws_.one_in(3) ? "-" : draws_.one_in(3) ? "+" : "") + pad + "kept: as it is" + pad + "  further\n\n";
      default:
        return std::string(" >") + (draws_.one_in(3) ? "-" : "") + pad + "folded" + pad + "lines\n" + pad + "end\n";
    }
  }

  std::string map(int column, int depth) {
    std::string text;
    const std::uint32_t count = 1 + draws_.below(depth == 0 ? 8 : 4);
    for (std::uint32_t i = 0; i < count; ++i) {
      const bool merges = !anchors_.empty() && draws_.one_in(40);
      if (merges)
        text += indented(column) + "<<: *" + std::string(draws_.of(anchors_)) + "\n";
      else
        text += indented(column) + key() + (draws_.one_in(30) ? " :" : ":") + value(column, depth, false);
    }
    return text;
  }

  std::string list(int column, int depth) {
    std::string text;
    const std::uint32_t count = 1 + draws_.below(4);
    for (std::uint32_t i = 0; i < count; ++i) text += indented(column) + "-" + value(column, depth, true);
    return text;
  }

  Draws& draws_;
  int keys_ = 0;
  std::vector<std::string> anchors_;
};

/// A text with 1 to 3 changes: a byte, a piece of a line, the order or the indentation of lines.
inline std::string mutated(std::string text, Draws& draws) {
  constexpr std::string_view bytes = " \t\n\r:-#&*!|>'\"%@`,[]{}?~<.=\\+019aeknxy_\x7f\xe2\x80\xa8";
  constexpr std::array<std::string_view, 14> pieces = {": ",  "- ", " #",     "\n  ", "---\n", "...", "<<: *a",
                                                       "&a ", "*a", "!!str ", "\\N",  "? ",    "''",  "\r\n"};
  const std::uint32_t changes = 1 + draws.below(3);
  for (std::uint32_t i = 0; i < changes && !text.empty(); ++i) {
    const std::size_t place = draws.below(text.size());
    const std::size_t line = text.rfind('\n', place) + 1, end = std::min(text.find('\n', place), text.size() - 1) + 1;
    switch (draws.below(8)) {
      case 0:
        text[place] = draws.of(bytes);
        break;
      case 1:
        text.insert(place, 1, draws.of(bytes));
        break;
      case 2:
        text.erase(place, 1 + draws.below(3));
        break;
      case 3:
        text.insert(place, draws.of(pieces));
        break;
      case 4:
        text.insert(line <= end ? line : 0, std::string(1 + draws.below(3), ' '));
        break;
      case 5:
        if (line < end) text.insert(draws.below(text.size()), text.substr(line, end - line));
        break;
      case 6:
        if (line < end) text.erase(line, end - line);
        break;
      default:
        text.resize(draws.one_in(4) ? place : text.size());
        break;
    }
  }
  return text;
}

}  // namespace earshot
