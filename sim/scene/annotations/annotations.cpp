// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/annotations/annotations.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "sim/base/errors.h"
#include "sim/base/text/text_match.h"
#include "sim/scene/readers/mesh_builder.h"

namespace earshot {

bool is_no_category(std::string_view category) {
  constexpr std::array<std::string_view, 6> words{kUnlabelled, "unlabeled", "unknown", "undefined", "void", "none"};
  const std::string folded = fold_case(category);
  return std::find(words.begin(), words.end(), folded) != words.end();
}

Annotations::Annotations(std::string where) : where_(std::move(where)), names_{{std::string(kUnlabelled), std::string(kUnlabelled)}} {}

void Annotations::add(std::int64_t id, std::string category, std::uint32_t color) {
  category = one_line(std::move(category));
  if (category.empty()) category = kUnlabelled;
  const auto number = static_cast<std::uint32_t>(names_.size());
  if (!of_id_.try_emplace(id, number).second) throw InputError(where_, fmt::format("has two entries with the id {}", id), "remove one");
  if (color != no_color && !of_color_.try_emplace(color, number).second)
    throw InputError(where_, fmt::format("gives the color {:06X} to two entries, the second with the id {}", color, id), "remove one");
  std::string object = fmt::format("{}_{}", category, id);
  names_.push_back({std::move(category), std::move(object)});
}

std::uint32_t Annotations::of_id(std::int64_t id) const {
  const auto found = of_id_.find(id);
  return found == of_id_.end() ? 0 : found->second;
}

std::uint32_t Annotations::of_color(std::uint32_t color) const {
  const auto found = of_color_.find(color);
  return found == of_color_.end() ? 0 : found->second;
}

}  // namespace earshot
