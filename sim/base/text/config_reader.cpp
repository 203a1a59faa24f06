#include "sim/base/text/config_reader.h"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <numeric>

#include "sim/base/files.h"
#include "sim/base/text/schema_version.h"
#include "sim/base/text/utf8.h"

namespace earshot {
namespace {

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

/// A node as one line of YAML, for messages.
std::string shown(const YAML::Node& node) {
  YAML::Emitter out;
  out << YAML::Flow << node;
  return out.good() ? std::string(out.c_str()) : std::string("?");
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
  constexpr const char* kKey = "schema_version";
  constexpr SchemaRange kConfig{.oldest = 1, .newest = 1};
  const YAML::Node node = root[kKey];
  if (!node.IsDefined()) return;
  std::int64_t version = 0;
  try {
    version = node.as<std::int64_t>();
  } catch (const YAML::Exception&) {
    throw InputError(where, std::string(kKey) + ": '" + shown(node) + "' cannot be read as a whole number", "");
  }
  check_schema_version(where, "a config", version, kConfig);
  root.remove(kKey);
}

/// Name of the type of a key, for messages.
template <class T>
std::string type_name() {
  if constexpr (std::is_same_v<T, bool>)
    return "true or false";
  else if constexpr (std::is_integral_v<T>)
    return "a whole number in range";
  else if constexpr (std::is_floating_point_v<T>)
    return "a number";
  else if constexpr (std::is_same_v<T, std::string>)
    return "text";
  else
    return "the list that this key takes";
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

ConfigReader::ConfigReader(Nodes nodes, std::string where, std::string prefix)
    : nodes_(std::make_shared<Nodes>(std::move(nodes))), where_(std::move(where)), prefix_(std::move(prefix)) {}

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
  for (const auto& text : overrides) apply_override(root, text, where);
  take_schema_version(root, where);
  if (!can_be_written(root))
    throw InputError(where, "contains text that cannot be written and read back unchanged", "do not use \\N and \\_ in quotes");
  return {Nodes{root}, std::move(where), ""};
}

ConfigReader ConfigReader::recorder() {
  const YAML::Node map(YAML::NodeType::Map), effective(YAML::NodeType::Map);
  ConfigReader reader({map, effective}, "recorder", "");
  reader.records_ = true;
  return reader;
}

template <ConfigValue T>
void ConfigReader::read(const std::string& key, T& value) {
  known_.insert(key);
  if (const YAML::Node node = nodes_->find(key)) {
    try {
      value = node.as<T>();
    } catch (const YAML::Exception&) {
      fail(key, "'" + shown(node) + "' cannot be read as " + type_name<T>());
    }
  }
  if (records_) nodes_->effective[key] = value;
}

template void ConfigReader::read(const std::string&, bool&);
template void ConfigReader::read(const std::string&, int&);
template void ConfigReader::read(const std::string&, std::uint32_t&);
template void ConfigReader::read(const std::string&, std::int64_t&);
template void ConfigReader::read(const std::string&, std::uint64_t&);
template void ConfigReader::read(const std::string&, float&);
template void ConfigReader::read(const std::string&, double&);
template void ConfigReader::read(const std::string&, std::string&);
template void ConfigReader::read(const std::string&, std::vector<int>&);
template void ConfigReader::read(const std::string&, std::vector<float>&);
template void ConfigReader::read(const std::string&, std::vector<double>&);
template void ConfigReader::read(const std::string&, std::vector<std::string>&);
template void ConfigReader::read(const std::string&, std::vector<std::vector<std::vector<double>>>&);

void ConfigReader::record(const std::string& key, const std::string& choice) { nodes_->effective[key] = choice; }

bool ConfigReader::has(const std::string& key) {
  known_.insert(key);
  return static_cast<bool>(nodes_->find(key));
}

ConfigReader ConfigReader::child(const std::string& key) {
  known_.insert(key);
  const YAML::Node node = nodes_->find(key);
  if (!node) {
    const YAML::Node map(YAML::NodeType::Map), effective(YAML::NodeType::Map);
    ConfigReader absent({map, effective}, where_, prefix_ + key + ".");
    if (records_) {
      absent.records_ = true;
      nodes_->effective[key] = effective;
    }
    return absent;
  }
  if (!node.IsMap()) fail(key, "must be a map of keys and values");
  return {Nodes{node}, where_, prefix_ + key + "."};
}

std::optional<std::string> ConfigReader::scalar(const std::string& key) {
  known_.insert(key);
  const YAML::Node node = nodes_->find(key);
  return node.IsScalar() ? std::optional(node.Scalar()) : std::nullopt;
}

std::optional<std::size_t> ConfigReader::list_size(const std::string& key) {
  known_.insert(key);
  const YAML::Node node = nodes_->find(key);
  return node.IsSequence() ? std::optional(node.size()) : std::nullopt;
}

std::optional<std::string> ConfigReader::list_scalar(const std::string& key, std::size_t index) {
  const YAML::Node item = nodes_->find(key)[index];
  return item.IsScalar() ? std::optional(item.Scalar()) : std::nullopt;
}

ConfigReader ConfigReader::list_child(const std::string& key, std::size_t index) {
  const YAML::Node item = nodes_->find(key)[index];
  const std::string where = where_ + " " + key + "[" + std::to_string(index) + "]";
  if (item.IsNull()) return {Nodes{YAML::Node(YAML::NodeType::Map)}, where, ""};
  if (!item.IsMap()) throw InputError(where, "is not a map of keys and values", "write 'key: value' lines");
  return {Nodes{item}, where, ""};
}

std::vector<std::string> ConfigReader::keys() {
  std::vector<std::string> names;
  for (const auto& item : nodes_->map) names.push_back(key_text(item.first));
  known_.insert(names.begin(), names.end());
  return names;
}

void ConfigReader::finish() const {
  for (const auto& item : nodes_->map) {
    const std::string key = key_text(item.first);
    if (known_.contains(key)) continue;
    const std::string nearest = nearest_word(key, known_);
    std::string all;
    for (const auto& name : known_) all += (all.empty() ? "" : ", ") + name;
    fail(key, "unknown key; " + (nearest.empty() ? "known keys: " + all : "did you mean '" + nearest + "'?"));
  }
}

void ConfigReader::fail(const std::string& key, const std::string& problem) const {
  throw InputError(where_, prefix_ + key + ": " + problem, "");
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
