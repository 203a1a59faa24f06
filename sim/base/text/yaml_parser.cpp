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
#include "sim/base/text/yaml_scalar.h"

namespace earshot {
namespace {

/// The text with line feeds alone at the ends of lines, without a byte-order mark at its head.
std::string with_line_feeds(std::string_view text, const YamlSource& source) {
  if (!is_utf8(text)) throw InputError(source.where, "is not UTF-8 text", "save it as UTF-8");
  if (text.starts_with("\xEF\xBB\xBF")) text.remove_prefix(3);
  std::string kept;
  kept.reserve(text.size());
  std::uint32_t line = 1;
  const auto refuse = [&](std::string_view problem, std::string_view remedy) { YamlCursor(text, source).fail(line, problem, remedy); };
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto byte = static_cast<unsigned char>(text[i]);
    if (byte == '\n') ++line;
    if (byte == '\r') {
      if (i + 1 == text.size() || text[i + 1] != '\n') refuse("has a carriage return without a line feed", "end lines with a line feed");
      continue;
    }
    char32_t character = byte;  // decoded as far as is_text_character distinguishes characters
    if (byte >= 0xC0 && byte < 0xE0) character = (byte & 0x1Fu) << 6 | (static_cast<unsigned char>(text[i + 1]) & 0x3Fu);
    if (byte >= 0xE0 && byte < 0xF0)
      character =
          (byte & 0x0Fu) << 12 | (static_cast<unsigned char>(text[i + 1]) & 0x3Fu) << 6 | (static_cast<unsigned char>(text[i + 2]) & 0x3Fu);
    if ((byte < 0x80 || (byte >= 0xC0 && byte < 0xF0)) && !is_text_character(character))
      refuse("has a character that does not belong into a text", "remove control characters, byte-order marks and special line ends");
    kept += text[i];
  }
  return kept;
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

class YamlParser {
 public:
  YamlParser(std::string_view text, const YamlSource& source) : cursor_(text, source) {}

  YamlNode document() {
    cursor_.skip_to_token();
    if (cursor_.peek() == '%' && cursor_.column() == 0) cursor_.fail("has a directive (%)", "take the line out");
    if (cursor_.is_marker("---")) {
      const std::uint32_t line = cursor_.line();
      cursor_.advance(3);
      cursor_.skip_to_token();
      if (!cursor_.is_at_end() && cursor_.line() == line) cursor_.fail("has a value behind '---'", "begin it in the next line");
    }
    YamlNode root{.line = cursor_.line()};
    if (!cursor_.is_at_end() && !is_marker()) root = block_node(-1);
    cursor_.skip_to_token();
    const bool has_ended = cursor_.is_marker("...");
    if (has_ended) {
      cursor_.advance(3);
      cursor_.skip_to_token();
    }
    if (cursor_.is_at_end()) return root;
    if (has_ended || cursor_.is_marker("---")) cursor_.fail("begins a second document", "keep one document in a file");
    cursor_.fail("is indented differently from the lines above", "begin the keys of one section in one column");
  }

 private:
  /// One level of lists and maps.
  class Level {
   public:
    explicit Level(YamlParser& parser) : parser_(parser) {
      if (++parser_.levels_ > kMaxYamlLevels)
        parser_.cursor_.fail(fmt::format("nests lists and maps more than {} levels deep", kMaxYamlLevels), "flatten it");
    }
    ~Level() { --parser_.levels_; }
    Level(const Level&) = delete;
    Level& operator=(const Level&) = delete;

   private:
    YamlParser& parser_;
  };

  /// The keys of one map, each with its line.
  using Seen = std::unordered_map<std::string, std::uint32_t>;

  struct Anchor {
    YamlNode node;
    std::uint32_t line = 0;
  };

  [[nodiscard]] bool is_marker() const { return cursor_.is_marker("---") || cursor_.is_marker("..."); }
  [[nodiscard]] bool is_entry() const { return cursor_.peek() == '-' && cursor_.is_blank(1); }

  /// A value whose first line begins here: block maps and lists may.  parent: column of the enclosing map or list.
  YamlNode block_node(int parent) {
    const Level level(*this);
    if (is_entry()) return block_list(cursor_.column());
    if (cursor_.peek() == '&') return anchored(parent, false);
    const bool can_be_key = std::string_view("*[{|>!").find(cursor_.peek()) == std::string_view::npos;
    if (can_be_key && cursor_.find_key_end() != std::string_view::npos) return block_map(cursor_.column());
    return value_in_line(parent);
  }

  YamlNode block_map(int column) {
    YamlNode map{.kind = YamlNode::Kind::map, .line = cursor_.line()};
    Seen seen;
    do {
      if (is_entry()) cursor_.fail("has a list item among the keys of a map", "indent the list, or make all of them keys");
      if (cursor_.peek() == '&' || cursor_.peek() == '*') cursor_.fail("has an anchor or alias for a key", "write the key");
      const std::size_t end = cursor_.find_key_end();
      const YamlNode::Key key = read_key(false);
      cursor_.skip_spaces();
      if (cursor_.at() != end) cursor_.fail("has a line without ':' among the keys of a map", "write 'key: value'");
      cursor_.advance();
      begin_value(map, key, seen);
      cursor_.skip_spaces();
      map.items.push_back(value(column, true));
      path_.pop_back();
      cursor_.skip_to_token();
    } while (cursor_.column() == column && !cursor_.is_at_end() && !is_marker());
    if (cursor_.column() > column && !cursor_.is_at_end())
      cursor_.fail("is indented differently from the lines above", "begin the keys of one section in one column");
    return map;
  }

  YamlNode block_list(int column) {
    YamlNode list{.kind = YamlNode::Kind::list, .line = cursor_.line()};
    do {
      cursor_.advance();
      cursor_.skip_spaces();
      path_.push_back(fmt::format("[{}]", list.items.size()));
      const bool is_in_line = !cursor_.is_line_end() && cursor_.peek() != '#';
      list.items.push_back(is_in_line ? block_node(column) : value(column, false));
      path_.pop_back();
      cursor_.skip_to_token();
    } while (cursor_.column() == column && is_entry() && !is_marker());
    if (cursor_.column() > column && !cursor_.is_at_end())
      cursor_.fail("is indented differently from the lines above", "begin the items of one list in one column");
    return list;
  }

  /// What follows "key:", "-" or an anchor, in the same line or in those below.  takes_list: a list below may begin in the column `parent`.
  YamlNode value(int parent, bool takes_list) {
    if (!cursor_.is_line_end() && cursor_.peek() != '#')
      return cursor_.peek() == '&' ? anchored(parent, takes_list) : value_in_line(parent);
    YamlNode absent{.line = cursor_.line()};
    cursor_.skip_to_token();
    if (cursor_.is_at_end() || is_marker()) return absent;
    if (cursor_.column() > parent) return block_node(parent);
    if (takes_list && cursor_.column() == parent && is_entry()) {
      const Level level(*this);
      return block_list(parent);
    }
    return absent;
  }

  YamlNode anchored(int parent, bool takes_list) {
    const std::string name = anchor_name();
    const std::uint32_t line = cursor_.line();
    cursor_.skip_spaces();
    if (cursor_.peek() == '&' || cursor_.peek() == '*') cursor_.fail("has two anchors or aliases for one value", "keep one");
    if (!cursor_.is_line_end() && cursor_.find_key_end() != std::string_view::npos && std::string_view("[{").find(cursor_.peek()) > 1)
      cursor_.fail("has an anchor before a key", "put it behind the ':' of the section");
    return keep_anchor(name, line, value(parent, takes_list));
  }

  /// A value that begins and, unless it is a text or in brackets, ends in this line.
  YamlNode value_in_line(int parent) {
    YamlNode node = simple_value({.parent = parent});
    if (node.is_scalar() && !node.is_plain && cursor_.is_line_end()) return node;  // a block text ends with its lines
    cursor_.expect_line_end();
    return node;
  }

  /// A scalar, an alias, or a list or map in brackets.
  YamlNode simple_value(const YamlPlace& place) {
    YamlNode node{.line = cursor_.line()};
    switch (cursor_.peek()) {
      case '[':
        return flow_list();
      case '{':
        return flow_map();
      case '*':
        return alias();
      case '"':
      case '\'':
        node.is_plain = false;
        node.text = read_quoted(cursor_, place);
        return node;
      case '|':
      case '>':
        if (place.in_flow) break;
        node.is_plain = false;
        node.text = read_block_text(cursor_, place.parent);
        return node;
      case '!':
        return tagged(place);
      default:
        break;
    }
    node.text = read_plain(cursor_, place);
    return node;
  }

  /// Programs write a tag before a number that would be a text to them.  It has to agree with the value.
  YamlNode tagged(const YamlPlace& place) {
    YamlNode node{.line = cursor_.line()};
    const std::string_view rest = cursor_.text().substr(cursor_.at());
    const bool is_whole = rest.starts_with("!!int "), is_number = rest.starts_with("!!float ");
    if (!is_whole && !is_number) check_plain_start(cursor_, place.in_flow);
    cursor_.advance(is_whole ? 6 : 8);
    cursor_.skip_spaces();
    node.text = read_plain(cursor_, place);
    if (is_whole ? !whole_digits(node.text) : !parse_decimal<double>(node.text))
      cursor_.fail(node.line, fmt::format("has a tag {} before '{}'", is_whole ? "!!int" : "!!float", node.text), "leave the tag out");
    return node;
  }

  YamlNode flow_list() {
    const Level level(*this);
    YamlNode list{.kind = YamlNode::Kind::list, .line = cursor_.line()};
    cursor_.advance();
    while (next_in_flow(']', list.line), cursor_.peek() != ']') {
      path_.push_back(fmt::format("[{}]", list.items.size()));
      list.items.push_back(flow_value());
      path_.pop_back();
      end_flow_item(']', list.line);
    }
    cursor_.advance();
    return list;
  }

  YamlNode flow_map() {
    const Level level(*this);
    YamlNode map{.kind = YamlNode::Kind::map, .line = cursor_.line()};
    Seen seen;
    cursor_.advance();
    while (next_in_flow('}', map.line), cursor_.peek() != '}') {
      if (cursor_.peek() == '&' || cursor_.peek() == '*') cursor_.fail("has an anchor or alias for a key", "write the key");
      const YamlNode::Key key = read_key(true);
      cursor_.skip_spaces();
      if (cursor_.peek() != ':')
        cursor_.fail(fmt::format("has '{}' without ': value' in {{ }}", key.text), "write '{key: value}', with a space");
      cursor_.advance();
      begin_value(map, key, seen);
      next_in_flow('}', map.line);
      const bool is_absent = cursor_.peek() == ',' || cursor_.peek() == '}';
      map.items.push_back(is_absent ? YamlNode{.line = cursor_.line()} : flow_value());
      path_.pop_back();
      end_flow_item('}', map.line);
    }
    cursor_.advance();
    return map;
  }

  YamlNode flow_value() {
    if (cursor_.peek() != '&') return simple_value({.in_flow = true});
    const std::string name = anchor_name();
    const std::uint32_t line = cursor_.line();
    cursor_.skip_spaces();
    if (std::string_view("&*,]}\n").find(cursor_.peek()) != std::string_view::npos || cursor_.is_at_end())
      cursor_.fail("has an anchor without a value", "write '&name value'");
    return keep_anchor(name, line, simple_value({.in_flow = true}));
  }

  void next_in_flow(char bracket, std::uint32_t line) {
    cursor_.skip_to_token();
    if (cursor_.is_at_end() || is_marker()) cursor_.fail(line, fmt::format("has a bracket without its '{}'", bracket), "close it");
  }

  void end_flow_item(char bracket, std::uint32_t line) {
    next_in_flow(bracket, line);
    if (cursor_.peek() == ',') return cursor_.advance();
    if (cursor_.peek() == bracket) return;
    if (cursor_.peek() == ':') cursor_.fail("has a ':' behind a value", "write {key: value} for a map within a list, or quote the text");
    cursor_.fail(line, fmt::format("has a bracket without its '{}', or values without ',' between them", bracket), "close it");
  }

  YamlNode::Key read_key(bool in_flow) {
    const bool is_quoted = cursor_.peek() == '"' || cursor_.peek() == '\'';
    if (cursor_.peek() == '[' || cursor_.peek() == '{') cursor_.fail("has a list or map for a key", "a key is a text");
    YamlNode::Key key{.text = {}, .line = cursor_.line(), .is_plain = !is_quoted};
    const YamlPlace place{.parent = -1, .in_flow = in_flow, .is_key = true};
    const std::size_t begin = cursor_.at();
    key.text = is_quoted ? read_quoted(cursor_, place) : read_plain(cursor_, place);
    if (cursor_.at() - begin > kMaxYamlKeyBytes)
      cursor_.fail(fmt::format("has a key of more than {} bytes", kMaxYamlKeyBytes), "shorten it");
    return key;
  }

  /// Notes a key of `map`, whose value is read next.
  void begin_value(YamlNode& map, const YamlNode::Key& key, Seen& seen) {
    const auto [first, is_new] = seen.emplace(key.text, key.line);
    path_.push_back(key.text);
    if (!is_new) {
      const bool is_near = first->second == key.line;
      cursor_.fail(key.line,
                   fmt::format("{} is given twice{}", path(), is_near ? "" : fmt::format(", in lines {} and {}", first->second, key.line)),
                   "keep one of the two");
    }
    map.keys.push_back(key);
  }

  [[nodiscard]] std::string path() const {
    std::string text;
    for (const std::string& part : path_) text += (text.empty() || part.starts_with('[') ? "" : ".") + part;
    return text;
  }

  /// Behind `&` or `*`.
  std::string anchor_name() {
    cursor_.advance();
    const std::size_t begin = cursor_.at();
    const auto belongs = [](char c) {
      return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
    };
    while (belongs(cursor_.peek())) cursor_.advance();
    const std::string name(cursor_.since(begin));
    const bool ends = cursor_.is_blank() || std::string_view(",]}").find(cursor_.peek()) != std::string_view::npos;
    if (name.empty() || !ends)
      cursor_.fail("has an anchor or alias without a plain name",
                   "use letters, digits, '_' and '-', or quote a text that begins with & or *");
    return name;
  }

  YamlNode keep_anchor(const std::string& name, std::uint32_t line, YamlNode node) {
    count_copy(node);
    const auto [known, is_new] = anchors_.emplace(name, Anchor{node, line});
    if (!is_new)
      cursor_.fail(line, fmt::format("sets the anchor &{} again, after line {}", name, known->second.line), "name each anchor once");
    return node;
  }

  YamlNode alias() {
    const std::string name = anchor_name();
    const auto known = anchors_.find(name);
    if (known == anchors_.end()) {
      std::set<std::string> names;
      for (const auto& [other, anchor] : anchors_) names.insert(other);
      const std::string nearest = nearest_word(name, names);
      cursor_.fail(fmt::format("has the alias *{}, whose anchor is not set above", name),
                   nearest.empty() ? fmt::format("set it by &{}, or quote a text that begins with *", name)
                                   : fmt::format("did you mean *{}?", nearest));
    }
    count_copy(known->second.node);
    return known->second.node;
  }

  void count_copy(const YamlNode& node) {
    copied_ += copied_bytes(node, kMaxYamlCopiedBytes - copied_);
    if (copied_ > kMaxYamlCopiedBytes)
      cursor_.fail(fmt::format("copies more than {} MB by aliases", kMaxYamlCopiedBytes >> 20), "write a smaller config");
  }

  YamlCursor cursor_;
  int levels_ = 0;
  std::size_t copied_ = 0;
  std::map<std::string, Anchor> anchors_;
  std::vector<std::string> path_;
};

}  // namespace

YamlNode parse_yaml(std::string_view text, const YamlSource& source) {
  const std::string lines = with_line_feeds(text, source);
  return YamlParser(lines, source).document();
}

}  // namespace earshot
