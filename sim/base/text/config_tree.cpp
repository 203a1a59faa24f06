// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/config_tree.h"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <set>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/text/utf8.h"
#include "sim/base/text/yaml_parser.h"

namespace earshot {
namespace {

YAML::Node written(const YamlNode& node) {
  if (node.is_null()) return YAML::Node(YAML::NodeType::Null);
  if (node.is_scalar()) return YAML::Node(node.text);
  YAML::Node copy(node.is_map() ? YAML::NodeType::Map : YAML::NodeType::Sequence);
  for (std::size_t i = 0; i < node.items.size(); ++i) {
    if (node.is_map())
      copy.force_insert(node.keys[i].text, written(node.items[i]));
    else
      copy.push_back(written(node.items[i]));
  }
  return copy;
}

/// Replaces each merge key `<<` without quotes by the keys of its map, or of its list of maps, that its own map does not have; of a list
/// the first map counts.  Throws InputError if its value is something else.
void merge_maps(YamlNode& node, const YamlSource& source) {
  for (YamlNode& item : node.items) merge_maps(item, source);
  const auto merge = std::ranges::find_if(node.keys, [](const YamlNode::Key& key) { return key.is_plain && key.text == "<<"; });
  if (merge == node.keys.end()) return;
  const auto place = merge - node.keys.begin();
  const std::uint32_t line = merge->line;
  std::vector<YamlNode> maps;
  YamlNode merged = std::move(node.items[static_cast<std::size_t>(place)]);
  if (merged.is_list())
    maps = std::move(merged.items);
  else
    maps.push_back(std::move(merged));
  node.keys.erase(merge);
  node.items.erase(node.items.begin() + place);
  std::set<std::string> names;
  for (const YamlNode::Key& key : node.keys) names.insert(key.text);
  for (YamlNode& map : maps) {
    if (!map.is_map()) source.fail(line, "<< merges something else than maps", "name a map by its alias, or a list of them");
    for (std::size_t i = 0; i < map.keys.size(); ++i) {
      if (!names.insert(map.keys[i].text).second) continue;
      node.keys.push_back(std::move(map.keys[i]));
      node.items.push_back(std::move(map.items[i]));
    }
  }
}

/// The map under `key`, made if it is absent.  Nothing if the key holds something else.
YamlNode* map_under(YamlNode& node, const std::string& key) {
  YamlNode* next = node.find(key);
  if (next == nullptr) {
    node.keys.push_back({.text = key});
    node.items.push_back(YamlNode::empty_map());
    return &node.items.back();
  }
  if (next->is_null()) *next = YamlNode::empty_map();
  return next->is_map() ? next : nullptr;
}

void remove_lines(YamlNode& node) {
  node.line = 0;
  for (YamlNode::Key& key : node.keys) key.line = 0;
  for (YamlNode& item : node.items) remove_lines(item);
}

void apply_override(YamlNode& root, const std::string& text, const std::string& where) {
  const auto equals = text.find('=');
  if (!is_utf8(text)) throw InputError("an override", "is not UTF-8 text", "write it in UTF-8 (" + where + ")");
  const std::string name = "override '" + text + "'";
  if (equals == std::string::npos || equals == 0)
    throw InputError(name, "is not of the form key=value", "write for example ppo.lr=1e-4 (" + where + ")");
  const YamlSource source{.where = name, .has_lines = false};
  YamlNode value = parse_yaml(std::string_view(text).substr(equals + 1), source);
  merge_maps(value, source);
  remove_lines(value);
  std::string path = text.substr(0, equals);
  if (std::ranges::count(path, '.') >= kMaxYamlLevels) throw InputError(name, "has too many levels", "check the key");
  YamlNode* node = &root;
  for (std::size_t dot = path.find('.'); dot != std::string::npos; dot = path.find('.')) {
    const std::string key = path.substr(0, dot);
    path.erase(0, dot + 1);
    node = map_under(*node, key);
    if (node == nullptr) throw InputError(name, "'" + key + "' is a value, not a map, in " + where, "check the key");
  }
  if (YamlNode* known = node->find(path)) {
    *known = std::move(value);
    return;
  }
  node->keys.push_back({.text = path});
  node->items.push_back(std::move(value));
}

bool is_same(const YamlNode& a, const YamlNode& b) {
  if (a.kind != b.kind || a.is_null() != b.is_null() || (!a.is_null() && a.text != b.text) || a.items.size() != b.items.size())
    return false;
  for (std::size_t i = 0; i < a.keys.size(); ++i)
    if (a.keys[i].text != b.keys[i].text) return false;
  return std::ranges::equal(a.items, b.items, is_same);
}

/// Runs write their resolved config, with which a checkpoint is read again.
void check_can_be_written(const YamlNode& root, const std::string& where) {
  bool can_be = false;
  try {
    can_be = is_same(root, parse_yaml(yaml_text(root), {.where = where}));
  } catch (const InputError&) {
  }
  if (!can_be)
    throw InputError(where, "contains text that cannot be written and read back unchanged", "shorten keys and leave out rare characters");
}

}  // namespace

YamlNode load_config_tree(std::string_view yaml, const std::string& where, const std::vector<std::string>& overrides, bool& has_keys) {
  const YamlSource source{.where = where};
  YamlNode root = parse_yaml(yaml, source);
  if (root.is_null()) root = YamlNode::empty_map();
  if (!root.is_map()) throw InputError(where, "is not a map of keys and values", "write 'key: value' lines");
  merge_maps(root, source);
  has_keys = !root.keys.empty();
  for (const auto& text : overrides) apply_override(root, text, where);
  check_can_be_written(root, where);
  return root;
}

std::string yaml_text(const YamlNode& node) { return YAML::Dump(written(node)); }

std::string yaml_line(const YamlNode& node) {
  YAML::Node copy = written(node);
  if (!node.is_scalar()) copy.SetStyle(YAML::EmitterStyle::Flow);
  YAML::Emitter text;
  text << copy;
  return text.c_str();
}

}  // namespace earshot
