// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/config_reader.h"

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <numeric>
#include <type_traits>

#include "sim/base/files.h"
#include "sim/base/text/config_value.h"
#include "sim/base/text/listed.h"
#include "sim/base/text/schema_version.h"
#include "sim/base/text/utf8.h"

namespace earshot {
namespace {

constexpr const char* kVersionKey = "schema_version";
constexpr SchemaRange kConfigVersions{.oldest = 1, .newest = 1};
constexpr std::size_t kMaxShownBytes = 100;

/// Levenshtein distance, one row of memory.
std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t above = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, diagonal + (a[i - 1] == b[j - 1] ? 0 : 1)});
      diagonal = above;
    }
  }
  return row.back();
}

/// Runs write their resolved config.  yaml-cpp's escapes \N and \_ give single bytes, of which that text cannot be made.
bool can_be_written(const YAML::Node& root) {
  const std::string text = YAML::Dump(root);
  if (!is_utf8(text)) return false;
  try {
    static_cast<void>(YAML::Load(text));
  } catch (const YAML::Exception&) {
    return false;
  }
  return true;
}

/// The beginning of a long text, for messages.
std::string shortened(const std::string& text) {
  if (text.size() <= kMaxShownBytes) return text;
  std::size_t end = kMaxShownBytes;
  while (end > 0 && (static_cast<unsigned char>(text[end]) & 0xC0u) == 0x80u) --end;  // not within a character
  return text.substr(0, end) + "...";
}

/// A node as one line of YAML, for messages.
std::string shown(const YAML::Node& node) {
  YAML::Emitter out;
  out << YAML::Flow << node;
  return shortened(out.good() ? std::string(out.c_str()) : std::string("?"));
}

/// A YAML key may itself be a list or a map; no known key is, so such a key is shown and matches none.
std::string key_text(const YAML::Node& key) { return key.IsScalar() ? key.Scalar() : shown(key); }

void apply_override(YAML::Node root, const std::string& text, const std::string& where) {
  const auto equals = text.find('=');
  if (!is_utf8(text)) throw InputError("an override", "is not UTF-8 text", "write it in UTF-8 (" + where + ")");
  if (equals == std::string::npos || equals == 0)
    throw InputError("override '" + text + "'", "is not of the form key=value", "write for example ppo.lr=1e-4 (" + where + ")");
  YAML::Node value;
  try {
    value = YAML::Load(text.substr(equals + 1));
  } catch (const YAML::Exception& error) {
    throw InputError("override '" + text + "'", error.msg, "quote the value as YAML requires");
  }
  std::string path = text.substr(0, equals);
  YAML::Node node = root;
  for (std::size_t dot = path.find('.'); dot != std::string::npos; dot = path.find('.')) {
    const std::string key = path.substr(0, dot);
    path.erase(0, dot + 1);
    if (node[key].IsDefined() && !node[key].IsMap())
      throw InputError("override '" + text + "'", "'" + key + "' is a value, not a map, in " + where, "check the key");
    YAML::Node next = node[key];
    if (!next.IsDefined() || next.IsNull()) {
      node[key] = YAML::Node(YAML::NodeType::Map);
      next = node[key];
    }
    node.reset(next);
  }
  node[path] = value;
}

/// The key that every YAML file may have at its top.  It is checked here and taken out: readers of the file do not see it.
void take_schema_version(YAML::Node root, const std::string& where) {
  const YAML::Node node = root[kVersionKey];
  if (!node.IsDefined()) return;
  std::int64_t version = 0;
  try {
    version = node.as<std::int64_t>();
  } catch (const YAML::Exception&) {
    throw InputError(where, std::string(kVersionKey) + " is " + shown(node), "use " + wanted_text(ConfigReader::schema_version_key()));
  }
  check_schema_version(where, "a config", version, kConfigVersions);
  root.remove(kVersionKey);
}

template <class T>
T parse_value(const YAML::Node& node, const Allowed& allowed) {
  if constexpr (is_number_type<T>)
    if (!allowed.word.empty() && allowed.other && node.IsScalar() && node.Scalar() == allowed.word) return static_cast<T>(*allowed.other);
  if constexpr (std::is_same_v<T, std::vector<std::string>>)
    if (allowed.accepts_scalar && node.IsScalar()) return {node.Scalar()};
  return node.as<T>();
}

/// The remedy in a message "KEY is VALUE".
std::string remedy_for(const ConfigKey& key) {
  return "use " + wanted_text(key) + (key.allowed.reason.empty() ? "" : ": " + std::string(key.allowed.reason));
}

}  // namespace

struct ConfigReader::Nodes {
  YAML::Node map;
  YAML::Node effective = {};  ///< of a recorder: part of its parent's

  /// The value under `key`; an undefined node if it is absent or null.
  [[nodiscard]] YAML::Node find(const std::string& key) const {
    const YAML::Node node = map[key];
    return node.IsDefined() && !node.IsNull() ? node : YAML::Node(YAML::NodeType::Undefined);
  }
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
  // YAML may also be UTF-16, which yaml-cpp guesses from the first bytes: of damaged ones it makes characters that it cannot read again.
  if (!is_utf8(yaml)) throw InputError(where, "is not UTF-8 text", "save it as UTF-8");
  YAML::Node root;
  try {
    root = YAML::Load(std::string(yaml));
  } catch (const YAML::Exception& error) {
    throw InputError(where + ":" + std::to_string(error.mark.line + 1), error.msg, "correct the YAML");
  }
  if (!root.IsDefined() || root.IsNull()) root = YAML::Node(YAML::NodeType::Map);
  if (!root.IsMap()) throw InputError(where, "is not a map of keys and values", "write 'key: value' lines");
  const bool has_keys = root.size() > 0;
  for (const auto& text : overrides) apply_override(root, text, where);
  take_schema_version(root, where);
  if (!can_be_written(root))
    throw InputError(where, "contains text that cannot be written and read back unchanged", "do not use \\N and \\_ in quotes");
  auto shared = std::make_shared<Shared>(Shared{.has_keys = has_keys, .overrides = overrides});
  return {Nodes{root}, std::move(shared), Mode::parsing, std::move(where), ""};
}

ConfigReader ConfigReader::without_file(Mode mode, const std::string& prefix) {
  const YAML::Node map(YAML::NodeType::Map), effective(YAML::NodeType::Map);
  return {{map, effective}, std::make_shared<Shared>(), mode, "config", prefix};
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
  if (const YAML::Node node = nodes_->find(key)) {
    std::optional<T> parsed;
    try {
      parsed = parse_value<T>(node, allowed);
    } catch (const YAML::Exception&) {
    }
    if (!parsed || !is_value_allowed(*parsed, allowed))
      throw InputError(place_of(key), prefix_ + key + " is " + shown(node), remedy_for(declared));
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
  const YAML::Node node = nodes_->find(key);
  if (!node) return std::nullopt;
  if (!node.IsScalar() || std::find(names.begin(), names.end(), node.Scalar()) == names.end())
    throw InputError(place_of(key), prefix_ + key + " is " + shown(node), remedy_for(declared));
  return node.Scalar();
}

bool ConfigReader::has(const std::string& key) const { return static_cast<bool>(nodes_->find(key)); }

ConfigReader ConfigReader::child(const std::string& key, About about) {
  known_.insert(key);
  const std::string prefix = prefix_ + key + ".";
  if (mode_ == Mode::describing) describe({.name = prefix_ + key, .type = KeyType::section, .about = std::string(about.text())});
  const YAML::Node node = nodes_->find(key);
  if (!node) {
    const YAML::Node map(YAML::NodeType::Map), effective(YAML::NodeType::Map);
    if (mode_ == Mode::recording) nodes_->effective[key] = effective;
    return {{map, effective}, shared_, mode_, where_, prefix};
  }
  if (!node.IsMap()) fail(key, "must be a map of keys and values");
  return {Nodes{node}, shared_, mode_, where_, prefix};
}

std::vector<ConfigReader> ConfigReader::children(const std::string& key, About about) {
  known_.insert(key);
  std::vector<ConfigReader> maps;
  if (mode_ == Mode::describing) {
    describe({.name = prefix_ + key + "[]", .type = KeyType::section, .about = std::string(about.text())});
    maps.push_back({{YAML::Node(YAML::NodeType::Map)}, shared_, mode_, where_, prefix_ + key + "[]."});
    return maps;
  }
  const YAML::Node node = nodes_->find(key);
  if (!node) return maps;
  if (!node.IsSequence()) fail(key, "must be a list of maps");
  for (std::size_t i = 0; i < node.size(); ++i) {
    const std::string name = key + "[" + std::to_string(i) + "]";
    const YAML::Node item = node[i];
    if (!item.IsMap() && !item.IsNull()) fail(name, "is not a map of keys and values");
    maps.push_back({Nodes{item.IsNull() ? YAML::Node(YAML::NodeType::Map) : item}, shared_, mode_, where_, prefix_ + name + "."});
  }
  return maps;
}

std::vector<std::string> ConfigReader::free_keys(const std::string& placeholder) const {
  std::vector<std::string> names;
  if (mode_ == Mode::describing) names.push_back(placeholder);
  for (const auto& item : nodes_->map) names.push_back(key_text(item.first));
  return names;
}

std::optional<std::string> ConfigReader::scalar(const std::string& key) const {
  const YAML::Node node = nodes_->find(key);
  return node.IsScalar() ? std::optional(node.Scalar()) : std::nullopt;
}

void ConfigReader::refuse(const std::vector<std::string>& keys, const std::string& problem) {
  for (const std::string& key : keys) {
    if (has(key)) fail(key, problem);
    shared_->refused.insert(prefix_ + key);
  }
}

void ConfigReader::finish() const {
  for (const auto& item : nodes_->map) {
    const std::string key = key_text(item.first);
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
    if (name != path && !path.starts_with(name + ".")) continue;
    return shared_->has_keys ? "override '" + shortened(*text) + "'" : where_ + " " + shortened(*text);
  }
  for (const auto& item : nodes_->map)
    if (const YAML::Mark mark = item.first.Mark(); key_text(item.first) == key && !mark.is_null())
      return where_ + ":" + std::to_string(mark.line + 1);
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

std::string ConfigReader::text() const { return YAML::Dump(nodes_->map) + "\n"; }

std::string nearest_word(std::string_view word, const std::set<std::string>& candidates) {
  std::string best;
  std::size_t best_distance = std::max<std::size_t>(2, word.size() / 3) + 1;
  for (const auto& candidate : candidates) {
    const std::size_t distance = edit_distance(word, candidate);
    if (distance < best_distance) {
      best_distance = distance;
      best = candidate;
    }
  }
  return best;
}

}  // namespace earshot
