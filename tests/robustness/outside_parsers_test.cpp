// SPDX-License-Identifier: Apache-2.0
// Files of others that are damaged: whatever the file, the run goes on.  SOFA is read by a library that a damaged file can crash.
#include "tests/support/files/outside_parsers.h"

namespace earshot {
namespace {

TEST(X_OutsideParsers, WholeMeshesLoad) {
  const TempFolder folder;
  for (const auto& [name, bytes] : small_meshes()) EXPECT_GE(import_mesh(folder.write(name, bytes)).mesh.triangles.size(), 1u) << name;
}

TEST(X_OutsideParsers, DamagedMeshesLoadOrGiveOneLine) {
  const Outcomes outcomes = read_damaged_meshes(25);
  record(outcomes);
  EXPECT_GT(outcomes.refused, 20) << "the damage is real";
  EXPECT_GT(outcomes.loaded, 20) << "and not total";
}

TEST(X_OutsideParsers, DamagedHeadsLoadOrGiveOneLine) {
  SKIP_WITHOUT_DATA("hrtf/MIT_KEMAR_normal_pinna.sofa");
  const Outcomes outcomes = read_damaged_heads(data_folder() / "hrtf/MIT_KEMAR_normal_pinna.sofa", 20);
  record(outcomes);
  EXPECT_GT(outcomes.refused, 3);
}

}  // namespace
}  // namespace earshot
