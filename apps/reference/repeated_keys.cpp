// SPDX-License-Identifier: Apache-2.0
#include "apps/reference/repeated_keys.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <map>

namespace earshot {
namespace {

constexpr std::size_t kFewestRepeated = 3;

/// The same but for its place and default.
bool is_same_key(const ConfigKey& a, const ConfigKey& b) {
  return name_in_section(a) == name_in_section(b) && a.type == b.type && a.about == b.about && allowed_text(a) == allowed_text(b) &&
         a.is_required == b.is_required;
}

const ConfigKey* find_key(const std::vector<ConfigKey>& keys, const ConfigKey& wanted) {
  const auto found = std::ranges::find_if(keys, [&](const ConfigKey& key) { return is_same_key(key, wanted); });
  return found == keys.end() ? nullptr : &*found;
}

/// The group beside the keys that it may repeat.
ShownSection section_with(const KeyGroup& group, const std::vector<ConfigKey>& before) {
  ShownSection section;
  section.group = group;
  for (const ConfigKey& key : before)
    if (find_key(group.keys, key) == nullptr) section.left_out.push_back(name_in_section(key));
  for (const ConfigKey& key : group.keys) {
    const ConfigKey* repeated = find_key(before, key);
    if (repeated == nullptr)
      section.own.push_back(key);
    else if (repeated->default_value != key.default_value)
      section.redefined.push_back(key);
  }
  return section;
}

std::string section_above(const std::string& section) {
  const std::size_t dot = section.rfind('.');
  return dot == std::string::npos ? "" : section.substr(0, dot);
}

std::string joined(const std::string& section, const std::string& name) { return section.empty() ? name : section + "." + name; }

}  // namespace

const ShownSections::Shown* ShownSections::find_repeated(const KeyGroup& group) const {
  const Shown* best = nullptr;
  std::size_t most = 0;
  for (const Shown& shown : shown_) {
    const auto common = static_cast<std::size_t>(
        std::ranges::count_if(group.keys, [&](const ConfigKey& key) { return find_key(shown.keys, key) != nullptr; }));
    if (common <= most || common < kFewestRepeated || 2 * common < shown.keys.size()) continue;
    best = &shown;
    most = common;
  }
  return best;
}

const ShownSections::Shown* ShownSections::find(const std::string& kind, const std::string& section) const {
  const auto found = std::ranges::find_if(shown_, [&](const Shown& shown) { return shown.kind == kind && shown.section == section; });
  return found == shown_.end() ? nullptr : &*found;
}

std::vector<ShownSection> ShownSections::show(const ConfigKind& kind) {
  std::vector<ShownSection> sections;
  std::map<std::string, const Shown*> repeated;  // by section of this kind
  std::map<std::string, std::size_t> shown_at;   // index in `sections` of the section, or of the one that stands for it
  for (const KeyGroup& group : groups_of(kind)) {
    const std::string parent = section_above(group.section);
    const Shown* above = group.section.empty() || !repeated.contains(parent) ? nullptr : repeated.at(parent);
    const Shown* within = above == nullptr
                              ? nullptr
                              : find(above->kind, joined(above->section, group.section.substr(parent.empty() ? 0 : parent.size() + 1)));
    ShownSection section = section_with(group, within != nullptr ? within->keys : std::vector<ConfigKey>{});
    const bool is_exact = within != nullptr && section.left_out.empty() && section.redefined.empty() && section.own.empty();
    const Shown* best = is_exact ? within : find_repeated(group);
    shown_.push_back({.kind = kind.name, .section = group.section, .anchor = anchor_of(kind, group.section), .keys = group.keys});
    if (best != nullptr) repeated[group.section] = best;
    if (is_exact) {
      shown_at[group.section] = shown_at.at(parent);
      sections[shown_at.at(parent)].has_repeated_sections = true;
      continue;
    }
    section = section_with(group, best != nullptr ? best->keys : std::vector<ConfigKey>{});
    if (best != nullptr) {
      section.place = best->section.empty() ? "a " + best->kind : fmt::format("{} of a {}", best->section, best->kind);
      section.anchor = best->anchor;
    }
    shown_at[group.section] = sections.size();
    sections.push_back(std::move(section));
  }
  return sections;
}

std::string anchor_of(const ConfigKind& kind, const std::string& section) {
  std::string anchor;
  for (const char c : section.empty() ? kind.name : kind.name + " " + section)
    anchor += std::isalnum(static_cast<unsigned char>(c)) != 0 ? static_cast<char>(std::tolower(static_cast<unsigned char>(c))) : '-';
  while (anchor.ends_with('-')) anchor.pop_back();
  return anchor;
}

}  // namespace earshot
