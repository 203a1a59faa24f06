// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/yaml_events.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <new>
#include <string>

namespace earshot {
namespace {

/// What a syntax error of libyaml is called, by a part of its description.
struct SyntaxError {
  std::string_view part, problem, remedy;
  bool is_at_begin = false;  ///< named where the part of the text begins, not where the error shows
};

constexpr std::string_view kIndented = "is indented differently from the lines above, or has text behind the end of a value";
constexpr std::string_view kOneColumn = "begin the keys or items of one section in one column, or quote the whole value";

constexpr std::array<SyntaxError, 19> kSyntaxErrors = {{
    {"scanning a quoted scalar: found unexpected", "has a quote that is not closed", "close it in the same line", true},
    {"parsing a quoted scalar", kWrongEscape, kEscapes},
    {"expected ',' or ']'", "has a bracket without its ']', or values without ',' between them", "close it, or quote a text", true},
    {"expected ',' or '}'", "has a bracket without its '}', or values without ',' between them", "close it, or quote a text", true},
    {"mapping values are not allowed", "has a second ':' in the line of a key, or a key that is indented like a part of the value above",
     "begin the keys of one section in one column, or quote a text that contains ': '"},
    {"did not find expected key", kIndented, kOneColumn},
    {"did not find expected '-' indicator", kIndented, kOneColumn},
    {"did not find expected <document start>", kIndented, kOneColumn},
    {"block sequence entries are not allowed", "has a '-' where a value or key begins",
     "begin a list in the line behind its key, or write [a, b]"},
    {"mapping keys are not allowed", "has a key behind '?'", "write 'key: value'"},
    {"did not find expected node content", "has no key or value where one begins", "write it, or quote a text"},
    {"scanning a plain scalar", "has a ':' before a bracket or comma", "write a space behind the ':' of a key, or quote the text"},
    {"scanning a block scalar", "has text behind '|' or '>', or lines below that are indented wrongly",
     "begin the text in the next line, with spaces"},
    {"could not find expected ':'", "has a line without ':' among the keys of a map", "write 'key: value'", true},
    {"cannot start any token", "has a value or key that begins with", "quote it"},
    {" tag", "has a tag (!), which gives a value another type", "leave it out: each key has one type; quote a text"},
    {" a directive", "has a directive (%)", "take the line out"},
    {"scanning an anchor", "has an anchor without a plain name", "use letters, digits, '_' and '-', or quote a text that begins with &"},
    {"scanning an alias", "has an alias without a plain name", "use letters, digits, '_' and '-', or quote a text that begins with *"},
}};

bool is_space(char c) { return c == ' ' || c == '\n'; }

}  // namespace

YamlEvents::YamlEvents(std::string_view text, const YamlSource& source) : text_(text), source_(source) {
  if (yaml_parser_initialize(&parser_) == 0) throw std::bad_alloc();
  yaml_parser_set_encoding(&parser_, YAML_UTF8_ENCODING);
  yaml_parser_set_input_string(&parser_, reinterpret_cast<const unsigned char*>(text.data()), text.size());
}

YamlEvents::~YamlEvents() {
  yaml_event_delete(&event_);
  yaml_parser_delete(&parser_);
}

const yaml_event_t& YamlEvents::next() {
  yaml_event_delete(&event_);
  if (yaml_parser_parse(&parser_, &event_) == 0) fail_syntax();
  return event_;
}

bool YamlEvents::pass_to_event() {
  return pass(event_.type == YAML_STREAM_END_EVENT ? text_.size() : byte_of(event_.start_mark), Part::separators);
}

void YamlEvents::pass_scalar() {
  const std::size_t begin = byte_of(event_.start_mark), end = byte_of(event_.end_mark);
  pass(begin, Part::separators);
  pass(end, event_.data.scalar.style == YAML_PLAIN_SCALAR_STYLE ? Part::plain_text : Part::before_quotes);
  const bool is_block_text = event_.data.scalar.style == YAML_LITERAL_SCALAR_STYLE || event_.data.scalar.style == YAML_FOLDED_SCALAR_STYLE;
  const std::size_t before = text_.substr(0, passed_).find_last_not_of(' ');
  if (is_block_text && before != std::string_view::npos && text_[before] == '\n')
    fail_at(passed_, fmt::format("has a '{}' at the beginning of a line", text_[passed_]), "write it behind its key, or quote the text");
  // '+' and widths are read differently by other readers.
  const std::string_view marks = is_block_text ? text_.substr(passed_ + 1, text_.find_first_of(" \t\r\n", passed_) - passed_ - 1) : "";
  if (!marks.empty() && marks != "-")
    fail_at(passed_, fmt::format("has '{}{}' before a text of several lines", text_[passed_], marks), "write '|', '>', '|-' or '>-'");
  passed_ = std::max(passed_, end);
}

bool YamlEvents::pass(std::size_t end, Part part) {
  bool has_colon = false;
  for (; passed_ < end; ++passed_) {
    const char c = text_[passed_];
    if (part == Part::before_quotes && (c == '"' || c == '\'' || c == '|' || c == '>')) break;
    has_colon = has_colon || c == ':';
    if (c == '\t') fail_at(passed_, "has a tab outside of quotes", "indent and separate with spaces");
    if (c == '?' && part == Part::separators) fail_at(passed_, "has a key behind '?'", "write 'key: value'");
    if (c != '#') continue;
    if (passed_ == 0 || is_space(text_[passed_ - 1]))
      passed_ = std::min(text_.find('\n', passed_), end) - 1;
    else if (part == Part::separators)
      fail_at(passed_, "has a '#' directly behind a value", "write a space before a comment");
  }
  return has_colon;
}

std::size_t YamlEvents::byte_of(const yaml_mark_t& mark) {
  const auto is_within = [&](std::size_t byte) {
    return byte < text_.size() && (static_cast<unsigned char>(text_[byte]) & 0xC0u) == 0x80u;
  };
  for (; last_index_ < mark.index && last_byte_ < text_.size(); ++last_index_) {
    ++last_byte_;
    while (is_within(last_byte_)) ++last_byte_;
  }
  for (; last_index_ > mark.index; --last_index_) {
    --last_byte_;
    while (is_within(last_byte_)) --last_byte_;
  }
  return last_byte_;
}

void YamlEvents::fail_at(std::size_t byte, std::string_view problem, std::string_view remedy) const {
  source_.fail(1 + static_cast<std::size_t>(std::ranges::count(text_.substr(0, byte), '\n')), problem, remedy);
}

void YamlEvents::fail_syntax() {
  if (parser_.error == YAML_MEMORY_ERROR) throw std::bad_alloc();
  const std::size_t byte = byte_of(parser_.problem_mark), line = parser_.problem_mark.line + 1;
  const std::string_view first = text_.substr(byte, 1);
  if (first == "\t") fail_at(byte, "has a tab outside of quotes", "indent and separate with spaces");
  const std::string context = parser_.context == nullptr ? "" : parser_.context;
  const std::string said = context + ": " + (parser_.problem == nullptr ? "" : parser_.problem);
  for (const SyntaxError& error : kSyntaxErrors) {
    if (said.find(error.part) == std::string::npos) continue;
    const std::string problem = std::string(error.problem) + (error.problem.ends_with("with") ? fmt::format(" '{}'", first) : "");
    source_.fail(error.is_at_begin && !context.empty() ? parser_.context_mark.line + 1 : line, problem, error.remedy);
  }
  source_.fail(line, "is not YAML (" + said + ")", "check the line and the one above");
}

}  // namespace earshot
