// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <yaml.h>

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "sim/base/text/yaml_node.h"

namespace earshot {

/// The tree of a text as libyaml reads it: aliases copied, nothing else resolved.
class LibyamlTree {
 public:
  /// Nothing if libyaml refuses the text, it holds several documents, or copies grow beyond a million nodes.
  static std::optional<YamlNode> of(std::string_view text) {
    LibyamlTree reader(text);
    return reader.read();
  }
  ~LibyamlTree() { yaml_parser_delete(&parser_); }

 private:
  struct Event {
    yaml_event_t event{};
    Event() = default;
    Event(const Event&) = delete;
    Event& operator=(const Event&) = delete;
    ~Event() { yaml_event_delete(&event); }
  };

  explicit LibyamlTree(std::string_view text) {
    yaml_parser_initialize(&parser_);
    yaml_parser_set_input_string(&parser_, reinterpret_cast<const unsigned char*>(text.data()), text.size());
  }
  LibyamlTree(const LibyamlTree&) = delete;
  LibyamlTree& operator=(const LibyamlTree&) = delete;

  std::unique_ptr<Event> next() {
    auto event = std::make_unique<Event>();
    if (yaml_parser_parse(&parser_, &event->event) == 0) failed_ = true;
    return event;
  }

  std::optional<YamlNode> read() {
    YamlNode root;
    int documents = 0;
    while (!failed_) {
      const std::unique_ptr<Event> event = next();
      if (failed_ || event->event.type == YAML_STREAM_END_EVENT) break;
      if (event->event.type != YAML_DOCUMENT_START_EVENT) continue;
      if (++documents > 1) return std::nullopt;
      root = node(*next());
    }
    return failed_ ? std::nullopt : std::optional(std::move(root));
  }

  YamlNode node(const Event& first) {
    YamlNode made;
    if (failed_ || ++nodes_ > 1'000'000) {
      failed_ = true;
      return made;
    }
    const yaml_event_t& event = first.event;
    const unsigned char* anchor = nullptr;
    if (event.type == YAML_ALIAS_EVENT) {
      const auto known = anchors_.find(text_of(event.data.alias.anchor));
      failed_ = known == anchors_.end();
      return failed_ ? made : known->second;
    }
    if (event.type == YAML_SCALAR_EVENT) {
      anchor = event.data.scalar.anchor;
      made.text.assign(reinterpret_cast<const char*>(event.data.scalar.value), event.data.scalar.length);
      made.is_plain = event.data.scalar.style == YAML_PLAIN_SCALAR_STYLE;
    } else if (event.type == YAML_SEQUENCE_START_EVENT) {
      anchor = event.data.sequence_start.anchor;
      made.kind = YamlNode::Kind::list;
      for (auto item = next(); !failed_ && item->event.type != YAML_SEQUENCE_END_EVENT; item = next()) made.items.push_back(node(*item));
    } else {
      anchor = event.data.mapping_start.anchor;
      made.kind = YamlNode::Kind::map;
      for (auto key = next(); !failed_ && key->event.type != YAML_MAPPING_END_EVENT; key = next()) {
        const YamlNode read = node(*key);
        made.keys.push_back({.text = read.is_scalar() ? read.text : "(no scalar)", .is_plain = read.is_plain});
        made.items.push_back(node(*next()));
      }
    }
    if (anchor != nullptr) anchors_[text_of(anchor)] = made;
    return made;
  }

  static std::string text_of(const unsigned char* text) { return reinterpret_cast<const char*>(text); }

  yaml_parser_t parser_{};
  bool failed_ = false;
  std::size_t nodes_ = 0;
  std::map<std::string, YamlNode> anchors_;
};

/// Where our tree of a text differs from libyaml's, or empty.
inline std::string difference(const YamlNode& ours, const YamlNode& theirs, const std::string& path = "") {
  if (ours.kind != theirs.kind || ours.items.size() != theirs.items.size()) return path + ": another kind or size";
  if (ours.text != theirs.text) return path + ": '" + ours.text + "' is '" + theirs.text + "' to libyaml";
  if (ours.is_scalar() && ours.is_plain != theirs.is_plain) return path + ": quotes";
  for (std::size_t i = 0; i < ours.items.size(); ++i) {
    const std::string name = path + (ours.is_map() ? "." + ours.keys[i].text : "[" + std::to_string(i) + "]");
    if (ours.is_map() && (ours.keys[i].text != theirs.keys[i].text || ours.keys[i].is_plain != theirs.keys[i].is_plain))
      return name + ": is the key '" + theirs.keys[i].text + "' to libyaml";
    if (std::string found = difference(ours.items[i], theirs.items[i], name); !found.empty()) return found;
  }
  return "";
}

}  // namespace earshot
