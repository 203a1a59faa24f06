// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <yaml.h>

#include <cstddef>
#include <string_view>

#include "sim/base/text/yaml_parser.h"

namespace earshot {

inline constexpr std::string_view kWrongEscape = "has an escape in quotes that stands for no character of a text";
inline constexpr std::string_view kEscapes =
    "use \\t, \\n, \\r, \\\", \\\\ or \\u and four digits; in single quotes a backslash is an ordinary character";

/// The events of a YAML text, one after the other, and what stands between its scalars.
class YamlEvents {
 public:
  /// text: UTF-8 whose lines end with a line feed.  Both outlive the object.
  YamlEvents(std::string_view text, const YamlSource& source);
  ~YamlEvents();
  YamlEvents(const YamlEvents&) = delete;
  YamlEvents& operator=(const YamlEvents&) = delete;

  /// Goes on to the next event.  Throws InputError where the text is not YAML.
  const yaml_event_t& next();
  /// The one that `next` gave last.
  [[nodiscard]] const yaml_event_t& event() const { return event_; }
  /// In which the event begins, from 1.
  [[nodiscard]] std::size_t line() const { return event_.start_mark.line + 1; }
  /// Bytes of the event.
  [[nodiscard]] std::string_view text() { return text_.substr(byte_of(event_.start_mark), length_of_event()); }
  /// Goes over separators, brackets, anchors and comments up to the event, or to the end of the text after the last one.  Returns whether a
  /// ':' is among them.  Throws InputError at a tab, at a '#' without a space before it, and at the '?' of a key.
  bool pass_to_event();
  /// Goes over the event, a scalar.  Throws InputError at a tab outside of quotes.
  void pass_scalar();
  /// Throws InputError "where:line: problem; remedy" with the line of the event.
  [[noreturn]] void fail(std::string_view problem, std::string_view remedy) const { source_.fail(line(), problem, remedy); }

 private:
  enum class Part { separators, plain_text, before_quotes };

  [[nodiscard]] std::size_t length_of_event() { return byte_of(event_.end_mark) - byte_of(event_.start_mark); }
  /// Place of a mark, which counts characters.
  std::size_t byte_of(const yaml_mark_t& mark);
  bool pass(std::size_t end, Part part);
  [[noreturn]] void fail_at(std::size_t byte, std::string_view problem, std::string_view remedy) const;
  [[noreturn]] void fail_syntax();

  std::string_view text_;
  const YamlSource& source_;
  yaml_parser_t parser_{};
  yaml_event_t event_{};
  std::size_t passed_ = 0;                      ///< bytes
  std::size_t last_byte_ = 0, last_index_ = 0;  ///< of the mark looked up last
};

}  // namespace earshot
