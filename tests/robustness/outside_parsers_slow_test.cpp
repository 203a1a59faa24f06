// SPDX-License-Identifier: Apache-2.0
// The long version of outside_parsers_test.cpp.
#include "tests/support/files/outside_parsers.h"

namespace earshot {
namespace {

TEST(X_OutsideParsersLong, DamagedMeshesLoadOrGiveOneLine) { record(read_damaged_meshes(400)); }

TEST(X_OutsideParsersLong, DamagedHeadsLoadOrGiveOneLine) {
  SKIP_WITHOUT_DATA("hrtf/MIT_KEMAR_normal_pinna.sofa");
  record(read_damaged_heads(data_folder() / "hrtf/MIT_KEMAR_normal_pinna.sofa", 400));
}

}  // namespace
}  // namespace earshot
