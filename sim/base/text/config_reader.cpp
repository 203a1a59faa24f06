// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/config_reader.h"

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <type_traits>

#include "sim/base/files.h"
#include "sim/base/text/config_number.h"
#include "sim/base/text/config_tree.h"
#include "sim/base/text/config_value.h"
#include "sim/base/text/listed.h"
#include "sim/base/text/schema_version.h"

namespace earshot {
namespace {

constexpr const char* kVersionKey = "schema_version";
constexpr SchemaRange kConfigVersions{.oldest = 1, .newest = 1};
constexpr std::size_t kMaxShownBytes = 100;

/// The beginning of a long text, for messages.
std::string shortened(const std::string& text) {
  if (text.size() <= kMaxShownBytes) return text;
  std::size_t end = kMaxShownBytes;
  while (end > 0 && (static_cast<unsigned char>(text[end]) & 0xC0u) == 0x80u) --end;  // not within a character
  return text.substr(0, end) + "...";
}

/// A node as one line of YAML, for messages: a scalar without quotes as it was written.
std::string shown(const YamlNode& node) {
  return shortened(node.is_scalar() && node.is_plain && !node.is_null() ? node.text : yaml_line(node));
}

/// The key that every YAML file may have at its top.  It is checked here and taken out: readers of the file do not see it.
void take_schema_version(YamlNode& root, const std::string& where) {
  const YamlNode* node = root.find(kVersionKey);
  if (node == nullptr) return;
  const std::optional<std::int64_t> version = node->is_scalar() ? parse_whole<std::int64_t>(node->text) : std::nullopt;
  if (!version)
    throw InputError(where, std::string(kVersionKey) + " is " + shown(*node), "use " + wanted_text(ConfigReader::schema_version_key()));
  check_schema_version(where, "a config", *version, kConfigVersions);
  const auto place = node - root.items.data();
  root.keys.erase(root.keys.begin() + place);
  root.items.erase(root.items.begin() + place);
}

std::optional<bool> parse_flag(const std::string& text) {
  std::string small = text;
  for (char& c : small) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  for (const char* word : {"true", "yes", "on", "y"})
    if (small == word) return true;
  for (const char* word : {"false", "no", "off", "n"})
    if (small == word) return false;
  return std::nullopt;
}

template <class T>
std::optional<T> parse_node(const YamlNode& node) {
  if constexpr (!std::is_same_v<T, typename ItemOf<T>::Type>) {
    if (!node.is_list()) return std::nullopt;
    T list;
    list.reserve(node.items.size());
    for (const YamlNode& item : node.items) {
      auto value = parse_node<typename ItemOf<T>::Type>(item);
      if (!value) return std::nullopt;
      list.push_back(std::move(*value));
    }
    return list;
  } else {
    if (!node.is_scalar() || node.is_null()) return std::nullopt;
    if constexpr (std::is_same_v<T, bool>)
      return parse_flag(node.text);
    else if constexpr (std::is_same_v<T, std::string>)
      return node.text;
    else if constexpr (std::is_integral_v<T>)
      return parse_whole<T>(node.text);
    else
      return parse_decimal<T>(node.text);
  }
}

template <class T>
std::optional<T> parse_value(const YamlNode& node, const Allowed& allowed) {
  if constexpr (is_number_type<T>)
    if (!allowed.word.empty() && allowed.other && node.is_scalar() && node.text == allowed.word) return static_cast<T>(*allowed.other);
  if constexpr (std::is_same_v<T, std::vector<std::string>>)
    if (allowed.accepts_scalar && node.is_scalar()) return T{node.text};
  return parse_node<T>(node);
}

/// decimal_hint of the first number of a value that needs one.
std::string hint_for(const YamlNode& node) {
  if (node.is_scalar()) return decimal_hint(node.text);
  for (const YamlNode& item : node.items)
    if (const std::string hint = hint_for(item); !hint.empty()) return hint;
  return "";
}

/// The remedy in a message "KEY is VALUE".
std::string remedy_for(const ConfigKey& key, const std::string& hint = "") {
  return "use " + wanted_text(key) + (key.allowed.reason.empty() ? "" : ": " + std::string(key.allowed.reason)) +
         (hint.empty() ? "" : "; " + hint);
}

std::shared_ptr<const YamlNode> empty_tree() { return std::make_shared<const YamlNode>(YamlNode::empty_map()); }

void flatten(const YamlNode& node, const std::string& prefix, std::map<std::string, std::string>& flat) {
  if (!node.is_map()) {
    flat[prefix] = yaml_line(node);
    return;
  }
  for (std::size_t i = 0; i < node.keys.size(); ++i) flatten(node.items[i], (prefix.empty() ? "" : prefix + ".") + node.keys[i].text, flat);
}

}  // namespace

struct ConfigReader::Nodes {
  std::shared_ptr<const YamlNode> map;  ///< part of the tree of its file, which it keeps
  YAML::Node effective = {};            ///< of a recorder: part of its parent's

  /// The value under `key`; nullptr if it is absent or null.
  [[nodiscard]] const YamlNode* find(const std::string& key) const {
    const YamlNode* node = map->find(key);
    return node != nullptr && !node->is_null() ? node : nullptr;
  }
  [[nodiscard]] Nodes of(const YamlNode& part) const { return {std::shared_ptr<const YamlNode>(map, &part)}; }
};

struct ConfigReader::Shared {
  bool has_keys = false;  ///< of the file, beside overrides
  std::vector<std::string> overrides = {};
  std::vector<ConfigKey> described = {};
  std::size_t last = 0;  ///< of described
  std::set<std::string> refused = {};
};

ConfigReader::ConfigReader(Nodes nodes, std::shared_ptr<Shared> shared, Mode mode, std::string where, std::string prefix)
    : nodes_(std::make_shared<Nodes>(std::move(nodes))),
      shared_(std::move(shared)),
      mode_(mode),
      where_(std::move(where)),
      prefix_(std::move(prefix)) {}

ConfigReader ConfigReader::from_file(const std::filesystem::path& path, const std::vector<std::string>& overrides) {
  return from_text(read_file(path, std::size_t{16} << 20), path.string(), overrides);
}

ConfigReader ConfigReader::from_text(std::string_view yaml, std::string where, const std::vector<std::string>& overrides) {
  auto shared = std::make_shared<Shared>(Shared{.overrides = overrides});
  YamlNode root = load_config_tree(yaml, where, overrides, shared->has_keys);
  take_schema_version(root, where);
  return {Nodes{std::make_shared<const YamlNode>(std::move(root))}, std::move(shared), Mode::parsing, std::move(where), ""};
}

ConfigReader ConfigReader::without_file(Mode mode, const std::string& prefix) {
  return {{empty_tree(), YAML::Node(YAML::NodeType::Map)}, std::make_shared<Shared>(), mode, "config", prefix};
}

ConfigReader ConfigReader::recorder() { return without_file(Mode::recording, ""); }

ConfigReader ConfigReader::describer() { return without_file(Mode::describing, ""); }

ConfigReader ConfigReader::checker(const std::string& section) {
  return without_file(Mode::checking, section.empty() ? "" : section + ".");
}

ConfigKey ConfigReader::schema_version_key() {
  return {.name = kVersionKey,
          .type = KeyType::whole_number,
          .allowed = Allowed::between(static_cast<double>(kConfigVersions.oldest), static_cast<double>(kConfigVersions.newest)),
          .default_value = std::to_string(kConfigVersions.oldest),
          .about = "Version of the file format; a program refuses versions that it does not know."};
}

template <ConfigValue T>
void ConfigReader::read(const std::string& key, T& value, const Allowed& allowed, About about) {
  known_.insert(key);
  ConfigKey declared = key_of<T>(prefix_ + key, allowed);
  if (mode_ == Mode::describing) {
    declared.default_value = value_text(value, allowed);
    declared.about = about.text();
    return describe(declared);
  }
  if (mode_ == Mode::checking && !is_value_allowed(value, allowed))
    throw InputError(where_, prefix_ + key + " is " + value_text(value, Allowed::any()), remedy_for(declared));
  if (const YamlNode* node = nodes_->find(key)) {
    std::optional<T> parsed = parse_value<T>(*node, allowed);
    if (!parsed || !is_value_allowed(*parsed, allowed))
      throw InputError(place_of(key), prefix_ + key + " is " + shown(*node), remedy_for(declared, parsed ? "" : hint_for(*node)));
    value = std::move(*parsed);
  }
  if (mode_ == Mode::recording) nodes_->effective[key] = value;
}

template void ConfigReader::read(const std::string&, bool&, const Allowed&, About);
template void ConfigReader::read(const std::string&, int&, const Allowed&, About);
template void ConfigReader::read(const std::string&, std::uint32_t&, const Allowed&, About);
template void ConfigReader::read(const std::string&, std::int64_t&, const Allowed&, About);
template void ConfigReader::read(const std::string&, std::uint64_t&, const Allowed&, About);
template void ConfigReader::read(const std::string&, float&, const Allowed&, About);
template void ConfigReader::read(const std::string&, double&, const Allowed&, About);
template void ConfigReader::read(const std::string&, std::string&, const Allowed&, About);
template void ConfigReader::read(const std::string&, std::vector<int>&, const Allowed&, About);
template void ConfigReader::read(const std::string&, std::vector<std::uint64_t>&, const Allowed&, About);
template void ConfigReader::read(const std::string&, std::vector<float>&, const Allowed&, About);
template void ConfigReader::read(const std::string&, std::vector<double>&, const Allowed&, About);
template void ConfigReader::read(const std::string&, std::vector<std::string>&, const Allowed&, About);
template void ConfigReader::read(const std::string&, std::vector<std::vector<std::vector<double>>>&, const Allowed&, About);

std::optional<std::string> ConfigReader::choose(const std::string& key, const std::string& current, const std::vector<std::string>& names,
                                                About about) {
  known_.insert(key);
  ConfigKey declared{.name = prefix_ + key, .type = KeyType::choice, .choices = names};
  if (mode_ == Mode::describing) {
    declared.default_value = current;
    declared.about = about.text();
    describe(declared);
  }
  if (mode_ == Mode::recording && !current.empty()) nodes_->effective[key] = current;
  const YamlNode* node = nodes_->find(key);
  if (node == nullptr) return std::nullopt;
  if (!node->is_scalar() || std::find(names.begin(), names.end(), node->text) == names.end())
    throw InputError(place_of(key), prefix_ + key + " is " + shown(*node), remedy_for(declared));
  return node->text;
}

bool ConfigReader::has(const std::string& key) const { return nodes_->find(key) != nullptr; }

ConfigReader ConfigReader::child(const std::string& key, About about) {
  known_.insert(key);
  const std::string prefix = prefix_ + key + ".";
  if (mode_ == Mode::describing) describe({.name = prefix_ + key, .type = KeyType::section, .about = std::string(about.text())});
  const YamlNode* node = nodes_->find(key);
  if (node == nullptr) {
    const YAML::Node effective(YAML::NodeType::Map);
    if (mode_ == Mode::recording) nodes_->effective[key] = effective;
    return {{empty_tree(), effective}, shared_, mode_, where_, prefix};
  }
  if (!node->is_map()) fail(key, "must be a map of keys and values");
  return {nodes_->of(*node), shared_, mode_, where_, prefix};
}

std::vector<ConfigReader> ConfigReader::children(const std::string& key, About about) {
  known_.insert(key);
  std::vector<ConfigReader> maps;
  if (mode_ == Mode::describing) {
    describe({.name = prefix_ + key + "[]", .type = KeyType::section, .about = std::string(about.text())});
    maps.push_back({{empty_tree()}, shared_, mode_, where_, prefix_ + key + "[]."});
    return maps;
  }
  const YamlNode* node = nodes_->find(key);
  if (node == nullptr) return maps;
  if (!node->is_list()) fail(key, "must be a list of maps");
  for (std::size_t i = 0; i < node->items.size(); ++i) {
    const std::string name = key + "[" + std::to_string(i) + "]";
    const YamlNode& item = node->items[i];
    if (!item.is_map() && !item.is_null()) fail(name, "is not a map of keys and values");
    maps.push_back({item.is_null() ? Nodes{empty_tree()} : nodes_->of(item), shared_, mode_, where_, prefix_ + name + "."});
  }
  return maps;
}

std::vector<std::string> ConfigReader::free_keys(const std::string& placeholder) const {
  std::vector<std::string> names;
  if (mode_ == Mode::describing) names.push_back(placeholder);
  for (const YamlNode::Key& key : nodes_->map->keys) names.push_back(key.text);
  return names;
}

std::optional<std::string> ConfigReader::scalar(const std::string& key) const {
  const YamlNode* node = nodes_->find(key);
  return node != nullptr && node->is_scalar() ? std::optional(node->text) : std::nullopt;
}

void ConfigReader::refuse(const std::vector<std::string>& keys, const std::string& problem) {
  for (const std::string& key : keys) {
    if (has(key)) fail(key, problem);
    shared_->refused.insert(prefix_ + key);
  }
}

void ConfigReader::finish() const {
  for (const YamlNode::Key& unread : nodes_->map->keys) {
    const std::string& key = unread.text;
    if (known_.contains(key)) continue;
    const std::string nearest = nearest_word(key, known_);
    fail(key, "unknown key; " + (nearest.empty() ? "known keys: " + listed(known_, ", ") : "did you mean '" + nearest + "'?"));
  }
}

void ConfigReader::fail(const std::string& key, const std::string& problem) const {
  throw InputError(place_of(key), prefix_ + key + ": " + problem, "");
}

std::string ConfigReader::place_of(const std::string& key) const {
  const std::string path = prefix_ + key;
  for (auto text = shared_->overrides.rbegin(); text != shared_->overrides.rend(); ++text) {
    const std::string name = text->substr(0, text->find('='));
    if (name != path && !path.starts_with(name + ".") && !path.starts_with(name + "[")) continue;
    return shared_->has_keys ? "override '" + shortened(*text) + "'" : where_ + " " + shortened(*text);
  }
  // Of an item of a list, "key[2]", the line in which it begins.
  const YamlNode* item = nullptr;
  if (const std::size_t bracket = key.rfind('['); key.ends_with(']') && nodes_->map->find(key) == nullptr)
    if (const YamlNode* list = nodes_->map->find(key.substr(0, bracket)); list != nullptr && list->is_list())
      if (const auto index = parse_whole<std::uint32_t>(key.substr(bracket + 1, key.size() - bracket - 2));
          index && *index < list->items.size())
        item = &list->items[*index];
  for (const YamlNode::Key& known : nodes_->map->keys)
    if (item == nullptr && known.text == key && known.line > 0) return where_ + ":" + std::to_string(known.line);
  if (item != nullptr && item->line > 0) return where_ + ":" + std::to_string(item->line);
  return where_;
}

void ConfigReader::describe(const ConfigKey& key) {
  std::vector<ConfigKey>& all = shared_->described;
  const auto known = std::find_if(all.begin(), all.end(), [&](const ConfigKey& other) { return other.name == key.name; });
  shared_->last = static_cast<std::size_t>(known - all.begin());
  if (known == all.end()) all.push_back(key);
}

ConfigKey& ConfigReader::last_described() { return shared_->described.at(shared_->last); }

std::vector<ConfigKey> ConfigReader::described() const {
  std::vector<ConfigKey> keys;
  for (const ConfigKey& key : shared_->described) {
    const bool is_refused = std::any_of(shared_->refused.begin(), shared_->refused.end(),
                                        [&](const std::string& name) { return key.name == name || key.name.starts_with(name + "."); });
    if (!is_refused) keys.push_back(key);
  }
  return keys;
}

std::string ConfigReader::effective() const { return YAML::Dump(nodes_->effective) + "\n"; }

std::string ConfigReader::text() const { return yaml_text(*nodes_->map) + "\n"; }

std::map<std::string, std::string> ConfigReader::flat() const {
  std::map<std::string, std::string> flat;
  flatten(*nodes_->map, "", flat);
  return flat;
}

}  // namespace earshot
