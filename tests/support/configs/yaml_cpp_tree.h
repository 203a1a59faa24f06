// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/exceptions.h>
#include <yaml-cpp/parser.h>

#include <map>
#include <optional>
#include <sstream>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "sim/base/text/yaml_node.h"

namespace earshot {

/// The tree of a text as yaml-cpp reads it: aliases copied, nothing else resolved but that a null without quotes has no text.
class YamlCppTree : private YAML::EventHandler {
 public:
  /// Nothing if yaml-cpp refuses the text, it holds several documents, or copies grow beyond a million nodes.
  static std::optional<YamlNode> of(std::string_view text) {
    try {
      std::istringstream stream{std::string(text)};
      YAML::Parser parser(stream);
      YamlCppTree tree;
      parser.HandleNextDocument(tree);
      YamlCppTree second;
      if (parser.HandleNextDocument(second)) return std::nullopt;
      return tree.root_;
    } catch (const YAML::Exception&) {
    } catch (const TooLarge&) {
    }
    return std::nullopt;
  }

 private:
  struct TooLarge {};
  struct Open {
    YamlNode node;
    YAML::anchor_t anchor = 0;
    bool has_key = false;  ///< of a map: its value comes next
  };

  void OnDocumentStart(const YAML::Mark&) override {}
  void OnDocumentEnd() override {}
  void OnAnchor(const YAML::Mark&, const std::string&) override {}
  void OnNull(const YAML::Mark&, YAML::anchor_t anchor) override { add({}, anchor); }
  void OnAlias(const YAML::Mark&, YAML::anchor_t anchor) override { add(anchors_[anchor], 0); }
  void OnScalar(const YAML::Mark&, const std::string& tag, YAML::anchor_t anchor, const std::string& value) override {
    add({.is_plain = tag != "!", .text = value}, anchor);
  }
  void OnSequenceStart(const YAML::Mark&, const std::string&, YAML::anchor_t anchor, YAML::EmitterStyle::value) override {
    open_.push_back({{.kind = YamlNode::Kind::list}, anchor});
  }
  void OnMapStart(const YAML::Mark&, const std::string&, YAML::anchor_t anchor, YAML::EmitterStyle::value) override {
    open_.push_back({{.kind = YamlNode::Kind::map}, anchor});
  }
  void OnSequenceEnd() override { close(); }
  void OnMapEnd() override { close(); }

  void close() {
    Open closed = std::move(open_.back());
    open_.pop_back();
    add(std::move(closed.node), closed.anchor);
  }

  static std::size_t size_of(const YamlNode& node) {
    std::size_t size = 1;
    for (const YamlNode& item : node.items) size += size_of(item);
    return size;
  }

  void add(YamlNode node, YAML::anchor_t anchor) {
    nodes_ += size_of(node);
    if (nodes_ > 1'000'000) throw TooLarge();
    if (anchor != 0) anchors_[anchor] = node;
    if (open_.empty()) {
      root_ = std::move(node);
      return;
    }
    Open& parent = open_.back();
    if (parent.node.is_map() && !parent.has_key) {
      parent.node.keys.push_back({.text = node.is_scalar() ? node.text : "(no scalar)", .is_plain = node.is_plain});
      parent.has_key = true;
      return;
    }
    parent.has_key = false;
    parent.node.items.push_back(std::move(node));
  }

  YamlNode root_;
  std::vector<Open> open_;
  std::map<YAML::anchor_t, YamlNode> anchors_;
  std::size_t nodes_ = 0;
};

/// Where our tree of a text differs from yaml-cpp's, or empty.
inline std::string difference(const YamlNode& ours, const YamlNode& theirs, const std::string& path = "") {
  if (ours.kind != theirs.kind || ours.items.size() != theirs.items.size()) return path + ": another kind or size";
  if (ours.is_null() && theirs.is_null()) return "";
  if (ours.text != theirs.text) return path + ": '" + ours.text + "' is '" + theirs.text + "' to yaml-cpp";
  if (ours.is_scalar() && ours.is_plain != theirs.is_plain) return path + ": quotes";
  for (std::size_t i = 0; i < ours.items.size(); ++i) {
    const std::string name = path + (ours.is_map() ? "." + ours.keys[i].text : "[" + std::to_string(i) + "]");
    if (ours.is_map()) {
      const YamlNode own{.is_plain = ours.keys[i].is_plain, .text = ours.keys[i].text};
      const YamlNode other{.is_plain = theirs.keys[i].is_plain, .text = theirs.keys[i].text};
      if (const std::string found = difference(own, other, name); !found.empty()) return found + ", a key";
    }
    if (std::string found = difference(ours.items[i], theirs.items[i], name); !found.empty()) return found;
  }
  return "";
}

}  // namespace earshot
