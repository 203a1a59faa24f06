// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/materials/semantic_materials.h"

#include <algorithm>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/config_reader.h"
#include "sim/base/text/text_match.h"

namespace earshot {
namespace {

std::string normalized(std::string_view name) {
  std::string text = fold_case(name);
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c == ' ' || c == '-'; }, '_');
  return text;
}

/// Without a number at the end and what separates it; the text itself if nothing would be left.
std::string without_number(const std::string& text) {
  std::size_t end = text.find_last_not_of("0123456789");
  if (end == std::string::npos || end + 1 == text.size()) return text;
  end = text.find_last_not_of("_.#", end);
  return end == std::string::npos ? text : text.substr(0, end + 1);
}

constexpr std::string_view indoor_yaml =
#include "builtin_semantics.inc"
    ;

}  // namespace

SemanticMaterials SemanticMaterials::from_yaml(std::string_view yaml, const std::string& where) {
  SemanticMaterials result;
  result.where_ = where;
  ConfigReader reader = ConfigReader::from_text(yaml, where);
  result.read(reader);
  reader.finish();
  if (result.candidates_.empty()) throw InputError(where, "has no categories", "write categories: {wall: [gypsum_board]}");
  return result;
}

void SemanticMaterials::read(ConfigReader& reader) {
  ConfigReader categories = reader.child("categories", "Materials by semantic category.");
  for (const std::string& category : categories.free_keys("CATEGORY")) {
    std::vector<std::string> names;
    categories.read_required(category, names, Allowed::text("the name of a material"),
                             "Materials of a category: the usual one, then others to draw from in randomization.");
    if (names.empty() && !reader.is_describing()) categories.fail(category, "is an empty list of materials");
    if (!candidates_.emplace(normalized(category), std::move(names)).second) categories.fail(category, "occurs twice");
  }
  categories.finish();
}

std::vector<ConfigKey> SemanticMaterials::keys() {
  ConfigReader describer = ConfigReader::describer();
  SemanticMaterials().read(describer);
  return describer.described();
}

SemanticMaterials SemanticMaterials::from_file(const std::filesystem::path& path) {
  return from_yaml(read_file(path, std::size_t{16} << 20), path.string());
}

SemanticMaterials SemanticMaterials::indoor() { return from_yaml(indoor_yaml, "built-in semantics"); }

std::string SemanticMaterials::category_of(std::string_view name) const {
  std::vector<std::string> texts = {normalized(name)};
  if (name.find('/') != std::string_view::npos) {
    std::size_t begin = 0;
    while (begin <= name.size()) {
      const std::size_t end = std::min(name.find('/', begin), name.size());
      texts.push_back(normalized(name.substr(begin, end - begin)));
      begin = end + 1;
    }
  }
  for (const bool numbered : {false, true}) {
    for (const std::string& text : texts) {
      std::string category = numbered ? without_number(text) : text;
      if (candidates_.contains(category)) return category;
    }
  }
  return {};
}

std::vector<const Material*> SemanticMaterials::materials_of(const std::string& category, const MaterialDatabase& database) const {
  std::vector<const Material*> materials;
  const auto found = candidates_.find(category);
  if (found == candidates_.end()) return materials;
  for (const std::string& name : found->second) {
    if (const Material* material = database.find(name)) materials.push_back(material);
  }
  return materials;
}

void SemanticMaterials::require_materials(const MaterialDatabase& database) const {
  for (const auto& [category, names] : candidates_) {
    for (const std::string& name : names) static_cast<void>(database.get(name, where_ + ": categories." + category));
  }
}

}  // namespace earshot
