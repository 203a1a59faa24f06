// SPDX-License-Identifier: Apache-2.0
// Materials of semantic categories.
#include "fuzz/fuzz_target.h"
#include "sim/scene/materials/semantic_materials.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  fuzz::expect_value_or_refusal([&] {
    const SemanticMaterials semantics = SemanticMaterials::from_yaml(fuzz::text_of(data, size), "semantics.yaml");
    for (const auto& [category, names] : semantics.all()) static_cast<void>(semantics.category_of(category + "/x_12"));
  });
  return 0;
}
