// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "sim/base/text/config_key.h"
#include "sim/scene/materials/materials.h"

namespace earshot {

class ConfigReader;

/// Which materials a thing of a semantic category (wall, sofa, tv_monitor) can be made of.  YAML: categories: {wall: [gypsum_board, ...]};
/// the first candidate is the usual one, the others are for randomization (acoustic_randomization.h).
class SemanticMaterials {
 public:
  /// Throws InputError: missing file, YAML, unknown key, a category given twice (after normalizing), an empty list.
  static SemanticMaterials from_file(const std::filesystem::path& path);
  static SemanticMaterials from_yaml(std::string_view yaml, const std::string& where);
  /// `indoor`: configs/semantic_materials.yaml, which travels inside the binary.  The 40 categories of Matterport3D, the classes of
  /// Replica, and common names of HM3D.
  static SemanticMaterials indoor();

  /// Candidates by category, both as the file has them; categories normalized.
  [[nodiscard]] const std::map<std::string, std::vector<std::string>>& all() const { return candidates_; }
  /// The category that a mesh material or a node is called by: the whole name, or one of its '/'-separated components, with letters in
  /// lower case, blanks and hyphens as underscores; then the same without a number at the end (chair_12, Chair.003).  Empty if none.  Never
  /// a part of a word: `vegetable` is not a table, `wall-lamp` is a wall_lamp and not a wall.
  [[nodiscard]] std::string category_of(std::string_view name) const;
  /// The candidates of a category that `database` has, as pointers into it; empty if there are none.
  [[nodiscard]] std::vector<const Material*> materials_of(const std::string& category, const MaterialDatabase& database) const;
  /// Throws InputError for the first candidate that `database` lacks, with the nearest name.
  void require_materials(const MaterialDatabase& database) const;

  /// All keys of such a file.
  static std::vector<ConfigKey> keys();

 private:
  void read(ConfigReader& reader);

  std::string where_;
  std::map<std::string, std::vector<std::string>> candidates_;
};

}  // namespace earshot
