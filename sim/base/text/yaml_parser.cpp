// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/yaml_parser.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>
#include <unordered_map>
#include <utility>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/text/config_number.h"
#include "sim/base/text/text_match.h"
#include "sim/base/text/utf8.h"
#include "sim/base/text/yaml_events.h"

namespace earshot {
namespace {

/// Place of the first control character but tab and line ends, separator of lines or paragraphs, byte-order mark, or code of no character.
std::size_t find_no_text(std::string_view text) {
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto byte = [&](std::size_t ahead) { return i + ahead < text.size() ? static_cast<unsigned char>(text[i + ahead]) : 0u; };
    const unsigned first = byte(0), second = byte(1), third = byte(2);
    const bool is_control =
        (first < 0x20 && first != '\t' && first != '\n' && first != '\r') || first == 0x7F || (first == 0xC2 && second < 0xA0);
    const bool is_separator = first == 0xE2 && second == 0x80 && (third == 0xA8 || third == 0xA9);
    const bool is_none = first == 0xEF && ((second == 0xBB && third == 0xBF) || (second == 0xBF && third >= 0xBE));
    if (is_control || is_separator || is_none) return i;
  }
  return std::string_view::npos;
}

/// The text with line feeds alone at the ends of lines, without a byte-order mark at its head.
std::string with_line_feeds(std::string_view text, const YamlSource& source) {
  if (!is_utf8(text)) throw InputError(source.where, "is not UTF-8 text", "save it as UTF-8");
  if (text.starts_with("\xEF\xBB\xBF")) text.remove_prefix(3);
  const auto refuse_at = [&](std::size_t at, std::string_view problem, std::string_view remedy) {
    source.fail(1 + static_cast<std::size_t>(std::ranges::count(text.substr(0, at), '\n')), problem, remedy);
  };
  if (const std::size_t at = find_no_text(text); at != std::string_view::npos)
    refuse_at(at, "has a character that does not belong into a text", "remove control characters, byte-order marks and special line ends");
  std::string kept;
  kept.reserve(text.size());
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '\r')
      kept += text[i];
    else if (text.substr(i + 1, 1) != "\n")
      refuse_at(i, "has a carriage return without a line feed", "end lines with a line feed");
  }
  return kept;
}

/// Whether an escape in double quotes is one that readers disagree on: yaml-cpp 0.7 reads \_ as a byte that is no UTF-8.
bool has_rare_escape(std::string_view quoted) {
  for (std::size_t i = quoted.find('\\'); i < quoted.size() - 1; i = quoted.find('\\', i + 2))
    if (std::string_view("tnr\"\\/xuU \t\n").find(quoted[i + 1]) == std::string_view::npos) return true;
  return false;
}

/// Bytes that a copy of the node takes, counted up to `limit`.
std::size_t copied_bytes(const YamlNode& node, std::size_t limit) {
  std::size_t bytes = sizeof(YamlNode) + node.text.size();
  for (const YamlNode::Key& key : node.keys) bytes += sizeof(YamlNode::Key) + key.text.size();
  for (const YamlNode& item : node.items) {
    if (bytes > limit) return bytes;
    bytes += copied_bytes(item, limit - bytes);
  }
  return bytes;
}

std::string text_of(const unsigned char* text) { return text == nullptr ? "" : reinterpret_cast<const char*>(text); }

/// Builds the tree of a text from its events.
class YamlTree {
 public:
  YamlTree(std::string_view text, const YamlSource& source) : events_(text, source), source_(source) {}

  YamlNode document() {
    events_.next();  // of the stream
    YamlNode root{.line = 1};
    if (events_.next().type != YAML_STREAM_END_EVENT) {
      if (events_.text().starts_with('%')) events_.fail("has a directive (%)", "take the line out");
      events_.next();
      root = node();
      events_.next();  // the end of the document
      if (events_.next().type != YAML_STREAM_END_EVENT) events_.fail("begins a second document", "keep one document in a file");
    }
    events_.pass_to_event();
    return root;
  }

 private:
  struct Anchor {
    YamlNode node;
    std::size_t line = 0;
  };

  /// The value that begins with the event.
  YamlNode node() {
    const yaml_event_t& event = events_.event();
    if (event.type == YAML_ALIAS_EVENT) return alias(text_of(event.data.alias.anchor));
    const bool is_list = event.type == YAML_SEQUENCE_START_EVENT;
    const std::size_t line = events_.line();
    if (event.type == YAML_SCALAR_EVENT) {
      const std::string anchor = text_of(event.data.scalar.anchor);
      return keep_anchor(anchor, line, scalar());
    }
    const std::string anchor = text_of(is_list ? event.data.sequence_start.anchor : event.data.mapping_start.anchor);
    if ((is_list ? event.data.sequence_start.tag : event.data.mapping_start.tag) != nullptr) refuse_tag();
    if (++levels_ > kMaxYamlLevels)
      events_.fail(fmt::format("nests lists and maps more than {} levels deep", kMaxYamlLevels), "flatten it");
    const int brackets =
        is_list ? event.data.sequence_start.style == YAML_FLOW_SEQUENCE_STYLE : event.data.mapping_start.style == YAML_FLOW_MAPPING_STYLE;
    brackets_ += brackets;
    YamlNode made = is_list ? list() : map();
    brackets_ -= brackets;
    --levels_;
    return keep_anchor(anchor, line, std::move(made));
  }

  [[noreturn]] void refuse_tag() const {
    events_.fail("has a tag (!), which gives a value another type", "leave it out: each key has one type; quote a text");
  }

  YamlNode scalar() {
    const auto& data = events_.event().data.scalar;
    YamlNode made{.is_plain = data.style == YAML_PLAIN_SCALAR_STYLE, .line = static_cast<std::uint32_t>(events_.line())};
    made.text.assign(reinterpret_cast<const char*>(data.value), data.length);
    if (find_no_text(made.text) != std::string::npos || (data.style == YAML_DOUBLE_QUOTED_SCALAR_STYLE && has_rare_escape(events_.text())))
      events_.fail(kWrongEscape, kEscapes);
    // Readers of YAML 1.1 end a text at the '?'.
    if (made.is_plain && brackets_ > 0 && made.text.find('?') != std::string::npos)
      events_.fail("has a '?' within [ ] or { }", "quote the value");
    if (data.tag != nullptr) check_tag(made);
    events_.pass_scalar();
    return made;
  }

  /// Programs write a tag before a number that would be a text to them.  It has to agree with the value.
  void check_tag(const YamlNode& value) {
    const bool is_whole = events_.text().find("!!int ") != std::string_view::npos;
    const bool is_number = events_.text().find("!!float ") != std::string_view::npos;
    if (!value.is_plain || is_whole == is_number) refuse_tag();
    if (is_whole ? !whole_digits(value.text) : !parse_decimal<double>(value.text))
      events_.fail(fmt::format("has a tag {} before '{}'", is_whole ? "!!int" : "!!float", value.text), "leave the tag out");
  }

  YamlNode list() {
    YamlNode made{.kind = YamlNode::Kind::list, .line = static_cast<std::uint32_t>(events_.line())};
    while (events_.next().type != YAML_SEQUENCE_END_EVENT) {
      const auto& pair = events_.event().data.mapping_start;
      const bool is_flow = events_.event().type == YAML_MAPPING_START_EVENT && pair.style == YAML_FLOW_MAPPING_STYLE;
      if (is_flow && pair.anchor == nullptr && pair.tag == nullptr && !events_.text().starts_with('{'))
        events_.fail("has a ':' behind a value", "write {key: value} for a map within a list, or quote the text");
      path_.push_back(fmt::format("[{}]", made.items.size()));
      made.items.push_back(node());
      path_.pop_back();
    }
    return made;
  }

  YamlNode map() {
    YamlNode made{.kind = YamlNode::Kind::map, .line = static_cast<std::uint32_t>(events_.line())};
    std::unordered_map<std::string, std::size_t> seen;
    while (events_.next().type != YAML_MAPPING_END_EVENT) {
      const YamlNode::Key read = key();
      path_.push_back(read.text);
      if (const auto [first, is_new] = seen.emplace(read.text, read.line); !is_new) {
        const std::string lines = first->second == read.line ? "" : fmt::format(", in lines {} and {}", first->second, read.line);
        events_.fail(path() + " is given twice" + lines, "keep one of the two");
      }
      events_.next();
      if (!events_.pass_to_event()) source_.fail(read.line, fmt::format("has '{}' without ': value'", read.text), "write 'key: value'");
      made.keys.push_back(read);
      made.items.push_back(node());
      path_.pop_back();
    }
    return made;
  }

  YamlNode::Key key() {
    const yaml_event_t& event = events_.event();
    events_.pass_to_event();
    if (event.type == YAML_ALIAS_EVENT || (event.type == YAML_SCALAR_EVENT && event.data.scalar.anchor != nullptr))
      events_.fail("has an anchor or alias for a key", "write the key");
    if (event.type != YAML_SCALAR_EVENT) events_.fail("has a list or map for a key", "a key is a text");
    if (event.data.scalar.tag != nullptr) refuse_tag();
    if (events_.text().size() > kMaxYamlKeyBytes)
      events_.fail(fmt::format("has a key of more than {} bytes", kMaxYamlKeyBytes), "shorten it");
    YamlNode read = scalar();
    return {.text = std::move(read.text), .line = read.line, .is_plain = read.is_plain};
  }

  [[nodiscard]] std::string path() const {
    std::string text;
    for (const std::string& part : path_) text += (text.empty() || part.starts_with('[') ? "" : ".") + part;
    return text;
  }

  YamlNode keep_anchor(const std::string& name, std::size_t line, YamlNode node) {
    if (name.empty()) return node;
    count_copy(node);
    const auto [known, is_new] = anchors_.emplace(name, Anchor{node, line});
    if (!is_new)
      source_.fail(line, fmt::format("sets the anchor &{} again, after line {}", name, known->second.line), "name each anchor once");
    return node;
  }

  YamlNode alias(const std::string& name) {
    events_.pass_to_event();
    if (const auto known = anchors_.find(name); known != anchors_.end()) {
      count_copy(known->second.node);
      return known->second.node;
    }
    std::set<std::string> names;
    for (const auto& [other, anchor] : anchors_) names.insert(other);
    const std::string nearest = nearest_word(name, names);
    events_.fail(fmt::format("has the alias *{}, whose anchor is not set above", name),
                 nearest.empty() ? fmt::format("set it by &{}, or quote a text that begins with *", name)
                                 : fmt::format("did you mean *{}?", nearest));
  }

  void count_copy(const YamlNode& node) {
    copied_ += copied_bytes(node, kMaxYamlCopiedBytes - copied_);
    if (copied_ > kMaxYamlCopiedBytes)
      events_.fail(fmt::format("copies more than {} MB by aliases", kMaxYamlCopiedBytes >> 20), "write a smaller config");
  }

  YamlEvents events_;
  const YamlSource& source_;
  int levels_ = 0, brackets_ = 0;  ///< open ones
  std::size_t copied_ = 0;
  std::map<std::string, Anchor> anchors_;
  std::vector<std::string> path_;
};

}  // namespace

void YamlSource::fail(std::size_t line, std::string_view problem, std::string_view remedy) const {
  throw InputError(has_lines ? where + ":" + std::to_string(line) : where, problem, remedy);
}

YamlNode parse_yaml(std::string_view text, const YamlSource& source) {
  const std::string lines = with_line_feeds(text, source);
  return YamlTree(lines, source).document();
}

}  // namespace earshot
