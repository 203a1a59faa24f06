// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "sim/scene/readers/surface_names.h"

namespace earshot {

/// Category, and object, of surfaces that the annotations say nothing of.
inline constexpr std::string_view kUnlabelled = "unlabelled";

/// Whether a data set writes this in place of a category: void, unknown, unlabeled and the like, in any case.
bool is_no_category(std::string_view category);

/// What a file of annotations says of the instances in a scene.
class Annotations {
 public:
  static constexpr std::uint32_t no_color = 0xFFFFFFFFu;

  /// where: the file, for messages.
  explicit Annotations(std::string where);

  /// category: as the data set ships it, blanks within; empty for kUnlabelled.  color: 0xRRGGBB or no_color.  The object is called
  /// "CATEGORY_ID".  Throws InputError for an id or a colour that occurs twice.
  void add(std::int64_t id, std::string category, std::uint32_t color = no_color);

  /// 0: of surfaces without an annotation.
  [[nodiscard]] const std::vector<SurfaceName>& names() const { return names_; }
  /// Index into names(); 0 where there is none.
  [[nodiscard]] std::uint32_t of_id(std::int64_t id) const;
  [[nodiscard]] std::uint32_t of_color(std::uint32_t color) const;
  /// Whether an instance has a colour: those of HM3D do.
  [[nodiscard]] bool has_colors() const { return !of_color_.empty(); }
  [[nodiscard]] const std::string& where() const { return where_; }

 private:
  std::string where_;
  std::vector<SurfaceName> names_;
  std::unordered_map<std::int64_t, std::uint32_t> of_id_;
  std::unordered_map<std::uint32_t, std::uint32_t> of_color_;
};

}  // namespace earshot
