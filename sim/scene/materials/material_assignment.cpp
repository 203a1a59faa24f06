// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/materials/material_assignment.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <tuple>

#include "sim/base/errors.h"
#include "sim/base/text/text_match.h"

namespace earshot {
namespace {

bool is_glob(std::string_view pattern) { return pattern.find_first_of("*?") != std::string_view::npos; }

/// Name first, then label, each compared as a whole and case-folded.
const Material* find_called(const MaterialDatabase& database, std::string_view category) {
  const std::string wanted = fold_case(category);
  for (const Material& material : database.all()) {
    if (fold_case(material.name) == wanted) return &material;
  }
  return database.find_label(category);
}

const Material* find_by_slot_name(const MaterialDatabase& database, std::string_view slot) {
  if (const Material* found = find_called(database, slot)) return found;
  while (slot.find('/') != std::string_view::npos) {
    const std::size_t end = slot.find('/');
    if (const Material* found = find_called(database, slot.substr(0, end))) return found;
    slot.remove_prefix(end + 1);
  }
  return find_called(database, slot);
}

/// The material of a slot, and why it is that one.
struct Decision {
  const Material* material = nullptr;
  MaterialChoice choice = {};
  /// That chose the material; empty: none did.
  [[nodiscard]] std::string category() const { return choice.reason == MaterialReason::category ? choice.by : std::string(); }
};

/// The rules with their materials looked up, remembering which patterns matched anything.
class RuleBook {
 public:
  RuleBook(const MaterialRules& rules, const MaterialDatabase& database, const std::string& where)
      : database_(database), semantics_(rules.semantics.get()), label_matching_(rules.label_matching), own_first_(rules.own_first) {
    for (const auto& [pattern, name] : rules.assign) {
      rules_.push_back({pattern, &database.get(name, where + ": assign." + pattern), is_glob(pattern)});
    }
    if (!rules.default_material.empty()) default_ = &database.get(rules.default_material, where + ": default_material");
    fallback_ = database.find_label("default");
  }

  /// No material: nothing answers.
  Decision decide(const std::string& slot, const std::string& node, const std::optional<Material>& slot_material) const {
    Decision decision = first_rule(slot, node, slot_material);
    if (semantics_) decision.choice.has_category = !(semantics_->category_of(slot).empty() && semantics_->category_of(node).empty());
    return decision;
  }

  void note_matches(const std::vector<std::string>& names) {
    for (Rule& rule : rules_) {
      rule.matched = rule.matched || std::any_of(names.begin(), names.end(), [&](const std::string& name) {
                       return rule.pattern == name || (rule.glob && glob_match(rule.pattern, name));
                     });
    }
  }

  void report_unmatched(const std::string& where, std::vector<std::string>& warnings) const {
    for (const Rule& rule : rules_) {
      if (!rule.matched) warnings.push_back(fmt::format("{}: assign.{} matches no mesh material and no node", where, rule.pattern));
    }
  }

 private:
  struct Rule {
    std::string pattern;
    const Material* material;
    bool glob;
    bool matched = false;
  };

  [[nodiscard]] const Rule* first_match(const std::string& name, bool glob) const {
    for (const Rule& rule : rules_) {
      if (glob ? rule.glob && glob_match(rule.pattern, name) : rule.pattern == name) return &rule;
    }
    return nullptr;
  }

  [[nodiscard]] Decision first_rule(const std::string& slot, const std::string& node, const std::optional<Material>& slot_material) const {
    for (const bool glob : {false, true}) {
      for (const std::string* name : {&slot, &node}) {
        if (const Rule* found = first_match(*name, glob)) return {found->material, {MaterialReason::pattern, found->pattern}};
      }
    }
    if (slot_material && own_first_) return {&*slot_material, {MaterialReason::own, slot}};
    if (semantics_) {
      for (const std::string* name : {&slot, &node}) {
        const std::string category = semantics_->category_of(*name);
        const std::vector<const Material*> materials = semantics_->materials_of(category, database_);
        if (!materials.empty()) return {materials.front(), {MaterialReason::category, category}};
      }
    }
    if (slot_material) return {&*slot_material, {MaterialReason::own, slot}};
    if (default_) return {default_, {MaterialReason::chosen_default, default_->name}};
    if (label_matching_ == LabelMatching::exact) {
      if (const Material* found = find_by_slot_name(database_, slot)) return {found, {MaterialReason::label, slot}};
    } else {
      for (const std::string* name : {&slot, &node}) {
        if (const Material* found = database_.find_by_substrings(*name)) return {found, {MaterialReason::label, *name}};
      }
    }
    return {fallback_, {MaterialReason::fallback}};
  }

  const MaterialDatabase& database_;
  const SemanticMaterials* semantics_;
  LabelMatching label_matching_;
  bool own_first_;
  std::vector<Rule> rules_;
  const Material* default_ = nullptr;
  const Material* fallback_ = nullptr;
};

}  // namespace

std::vector<Material> assign_materials(TriangleMesh& mesh, const MaterialRules& rules, const MaterialDatabase& database,
                                       const std::vector<std::optional<Material>>& slot_materials, const std::string& where,
                                       std::vector<std::string>& warnings, std::vector<MaterialChoice>* choices) {
  RuleBook book(rules, database, where);
  book.note_matches(mesh.material_names);
  book.note_matches(mesh.object_names);
  book.report_unmatched(where, warnings);

  const std::vector<std::string> old_names = std::move(mesh.material_names);
  mesh.material_names.clear();
  std::vector<Material> materials;
  using SlotOfPair = std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t>;                  // (old slot, node) -> new slot
  using SlotOfMaterial = std::map<std::tuple<std::uint32_t, std::string, std::string>, std::uint32_t>;  // (old, material, category) -> new
  SlotOfPair slot_of_pair;
  SlotOfMaterial slot_of_material;
  std::vector<bool> slot_taken(old_names.size(), false);
  const std::optional<Material> no_material;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const std::uint32_t slot = mesh.triangle_material[t], node = mesh.triangle_object[t];
    const auto [pair, is_new_pair] = slot_of_pair.try_emplace({slot, node}, 0u);
    if (is_new_pair) {
      const Decision decision =
          book.decide(old_names[slot], mesh.object_names[node], slot < slot_materials.size() ? slot_materials[slot] : no_material);
      const Material* material = decision.material;
      const std::string category = decision.category();
      if (!material) {
        throw InputError(where, fmt::format("no material for '{}', and the database has no material labelled 'default'", old_names[slot]),
                         "set default_material, or label an entry 'default'");
      }
      const auto [split, is_new_slot] =
          slot_of_material.try_emplace({slot, material->name, category}, static_cast<std::uint32_t>(materials.size()));
      if (is_new_slot) {
        mesh.material_names.push_back(
            slot_taken[slot] ? fmt::format("{} ({})", old_names[slot], category.empty() ? material->name : category) : old_names[slot]);
        slot_taken[slot] = true;
        materials.push_back(*material);
        materials.back().category = category;
        if (choices) choices->push_back(decision.choice);
      }
      pair->second = split->second;
    }
    mesh.triangle_material[t] = pair->second;
  }
  return materials;
}

}  // namespace earshot
