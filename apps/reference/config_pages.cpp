// SPDX-License-Identifier: Apache-2.0
#include "apps/reference/config_pages.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "apps/reference/repeated_keys.h"
#include "sim/base/text/json.h"
#include "sim/base/text/listed.h"

namespace earshot {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kMinWidth = 60, kIndent = 6;

std::string default_text(const ConfigKey& key) {
  if (key.is_required) return "required";
  return key.default_value.value_or("none");
}

/// The text in lines of at most `width` characters, each after `indent` blanks.
std::string wrapped(const std::string& text, std::size_t indent, std::size_t width) {
  const std::string margin(indent, ' ');
  std::string out, line;
  const auto end_line = [&] {
    if (!line.empty()) out += margin + line + "\n";
    line.clear();
  };
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find(' ', at), text.size());
    const std::string word = text.substr(at, end - at);
    at = end + 1;
    if (!line.empty() && indent + line.size() + 1 + word.size() > width) end_line();
    if (!word.empty()) line += (line.empty() ? "" : " ") + word;
  }
  end_line();
  return out;
}

using Row = std::array<std::string, 5>;

Row row_of(const ConfigKey& key) {
  return {name_in_section(key), type_text(key), default_text(key), unit_of_key(key.name), allowed_text(key)};
}

std::string table_text(const std::vector<ConfigKey>& keys, std::size_t width) {
  if (keys.empty()) return "";
  std::vector<Row> rows{{"key", "type", "default", "unit", "range"}};
  for (const ConfigKey& key : keys) rows.push_back(row_of(key));
  std::array<std::size_t, 5> widths{};
  for (const Row& row : rows)
    for (std::size_t column = 0; column < row.size(); ++column) widths[column] = std::max(widths[column], row[column].size());
  std::string text;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Row& row = rows[i];
    std::string line = "  ";
    for (std::size_t column = 0; column + 1 < row.size(); ++column) line += fmt::format("{:<{}}  ", row[column], widths[column]);
    // A long range has lines of its own below the row.
    const bool fits = line.size() + row.back().size() <= width;
    if (fits) line += row.back();
    line.erase(line.find_last_not_of(' ') + 1);
    text += line + "\n";
    if (!fits) text += wrapped("range: " + row.back(), kIndent, width);
    if (i > 0) text += wrapped(keys[i - 1].about, kIndent, width);
  }
  return text;
}

/// "As in env.acoustics of a run config, without threads. Other defaults: rir_length_s 1."
std::string repetition_text(const ShownSection& section, const std::string& place) {
  std::string text = "As in " + place;
  if (!section.left_out.empty()) text += ", without " + listed(section.left_out, ", ");
  if (section.has_repeated_sections) text += ", with the sections there";
  text += ".";
  std::vector<std::string> defaults;
  for (const ConfigKey& key : section.redefined) defaults.push_back(name_in_section(key) + " " + default_text(key));
  if (!defaults.empty()) text += " Other defaults: " + listed(defaults, ", ") + ".";
  return text;
}

std::string section_text(const ShownSection& section, std::size_t width) {
  const KeyGroup& group = section.group;
  std::string text;
  if (!group.section.empty()) text = wrapped(group.section + (group.about.empty() ? "" : ": " + group.about), 0, width);
  if (!section.place.empty()) text += wrapped(repetition_text(section, section.place), 2, width);
  return text + table_text(section.own, width);
}

bool is_within(const std::string& name, const std::string& section) { return name == section || name.starts_with(section + "."); }

/// Sections of a kind that `name` stands for, with those in them.
std::vector<KeyGroup> sections_named(const ConfigKind& kind, const std::string& name) {
  std::string section;
  for (const ConfigKey& key : kind.keys)
    if (key.type == KeyType::section && stands_for(key, name)) section = key.name;
  std::vector<KeyGroup> found;
  if (section.empty()) return found;
  for (const KeyGroup& group : groups_of(kind))
    if (is_within(group.section, section)) found.push_back(group);
  return found;
}

/// All that is told of one key, without the kinds that have it.
std::string one_key_text(const ConfigKey& key, std::size_t width) {
  std::string text = wrapped(key.about, 2, width);
  const auto add = [&](const char* label, const std::string& value) {
    if (!value.empty()) text += fmt::format("  {:<9}{}\n", label, value);
  };
  add("type", type_text(key));
  add("default", default_text(key));
  add("unit", unit_of_key(key.name));
  add("range", allowed_text(key));
  add("reason", std::string(key.allowed.reason));
  return text;
}

std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '|' || c == '*' || c == '<' || c == '>' || c == '[' || c == ']') out += '\\';
    out += c;
  }
  return out;
}

std::string code(const std::string& text) {
  if (text.empty()) return "";
  std::string out;
  for (const char c : text) out += c == '|' ? std::string("\\|") : std::string(1, c);
  return "`" + out + "`";
}

std::string table_markdown(const std::vector<ConfigKey>& keys) {
  if (keys.empty()) return "";
  std::string text = "| key | type | default | unit | range | description |\n|---|---|---|---|---|---|\n";
  for (const ConfigKey& key : keys) {
    const std::string shown_default = key.is_required ? "required" : key.default_value ? code(*key.default_value) : "none";
    text += fmt::format("| {} | {} | {} | {} | {} | {} |\n", code(name_in_section(key)), type_text(key), shown_default,
                        unit_of_key(key.name), escaped(allowed_text(key)), escaped(key.about));
  }
  return text + "\n";
}

Json json_of(const ConfigKey& key) {
  const auto bound = [](double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); };
  Json json{{"key", key.name}, {"type", type_text(key)}, {"about", key.about}};
  if (key.type == KeyType::section) return json;
  json["default"] = key.default_value ? Json(*key.default_value) : Json(nullptr);
  json["required"] = key.is_required;
  json["unit"] = unit_of_key(key.name);
  json["range"] = allowed_text(key);
  json["low"] = bound(key.allowed.low);
  json["high"] = bound(key.allowed.high);
  json["choices"] = key.choices;
  return json;
}

}  // namespace

std::string reference_text(const std::vector<ConfigKind>& reference, std::size_t width) {
  width = std::max(width, kMinWidth);
  ShownSections shown;
  std::string text;
  for (const ConfigKind& kind : reference) {
    text += (text.empty() ? "" : "\n") + kind.name + "\n" + std::string(kind.name.size(), '=') + "\n" + wrapped(kind.about, 0, width);
    for (const ShownSection& section : shown.show(kind)) text += "\n" + section_text(section, width);
  }
  return text;
}

std::string key_text(const std::vector<ConfigKind>& reference, const std::string& name, std::size_t width) {
  width = std::max(width, kMinWidth);
  std::vector<std::pair<std::string, std::vector<std::string>>> answers;  // the description, and the kinds that it applies to
  const auto add = [&](const std::string& answer, const std::string& kind) {
    const auto known = std::ranges::find_if(answers, [&](const auto& other) { return other.first == answer; });
    if (known == answers.end())
      answers.push_back({answer, {kind}});
    else
      known->second.push_back(kind);
  };
  for (const ConfigKind& kind : reference) {
    if (kind.name == name) add(reference_text({kind}, width), "");
    std::string sections;
    for (const KeyGroup& group : sections_named(kind, name)) {
      ShownSection all;
      all.group = group;
      all.own = group.keys;
      sections += (sections.empty() ? "" : "\n") + section_text(all, width);
    }
    if (!sections.empty()) add(sections, kind.name);
    for (const ConfigKey& key : kind.keys)
      if (key.type != KeyType::section && stands_for(key, name)) add(key.name + "\n" + one_key_text(key, width), kind.name);
  }
  std::string text;
  for (const auto& [answer, kinds] : answers) {
    text += (text.empty() ? "" : "\n") + answer;
    if (!kinds.front().empty()) text += wrapped("in: " + listed(kinds, ", "), 2, width);
  }
  return text;
}

std::string reference_markdown(const std::vector<ConfigKind>& reference) {
  std::string text =
      "# Config keys\n\nEvery key of every config file, with its default, unit and range. The program prints the same:\n\n"
      "```console\n$ earshot config ppo.clip\n" +
      key_text(reference, "ppo.clip", 100) +
      "```\n\n`earshot config` prints all keys, `earshot config ppo` a section. A file may set any of them; a key that is absent keeps "
      "its "
      "default. Commands set keys with `--set key=value`, `earshot train` with `key=value`.\n\n";
  ShownSections shown;
  for (const ConfigKind& kind : reference) {
    text += fmt::format("({})=\n## {}{}\n\n{}\n\n", anchor_of(kind, ""), static_cast<char>(std::toupper(kind.name[0])), kind.name.substr(1),
                        escaped(kind.about));
    for (const ShownSection& section : shown.show(kind)) {
      const KeyGroup& group = section.group;
      if (!group.section.empty())
        text += fmt::format("({})=\n### {}\n\n{}\n\n", anchor_of(kind, group.section), code(group.section), escaped(group.about));
      if (!section.place.empty())
        text += repetition_text(section, fmt::format("[{}](#{})", escaped(section.place), section.anchor)) + "\n\n";
      text += table_markdown(section.own);
    }
  }
  while (text.ends_with("\n\n")) text.pop_back();
  return text;
}

std::string reference_json(const std::vector<ConfigKind>& reference, const std::string& name) {
  Json kinds = Json::array();
  for (const ConfigKind& kind : reference) {
    Json keys = Json::array();
    const std::vector<KeyGroup> named = name.empty() ? std::vector<KeyGroup>{} : sections_named(kind, name);
    for (const ConfigKey& key : kind.keys) {
      const bool is_asked = name.empty() || kind.name == name || stands_for(key, name) ||
                            std::ranges::any_of(named, [&](const KeyGroup& group) { return is_within(key.name, group.section); });
      if (is_asked) keys.push_back(json_of(key));
    }
    if (!keys.empty()) kinds.push_back({{"kind", kind.name}, {"about", kind.about}, {"keys", std::move(keys)}});
  }
  return json_text(Json{{"schema_version", 1}, {"kinds", std::move(kinds)}}, 1) + "\n";
}

}  // namespace earshot
