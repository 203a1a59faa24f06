// SPDX-License-Identifier: Apache-2.0
// glTF and GLB through gltf_reader.h, the mesh builder and the repair.
#include "fuzz/fuzz_target.h"
#include "sim/scene/readers/mesh_import.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  static const fuzz::InputFile file("mesh.gltf");
  fuzz::expect_value_or_refusal([&] {
    const ImportedMesh imported = import_mesh(file.write(fuzz::text_of(data, size)));
    for (const glm::uvec3 corners : imported.mesh.triangles)
      for (int corner = 0; corner < 3; ++corner)
        if (corners[corner] >= imported.mesh.vertices.size()) fuzz::report("a triangle points nowhere", "");
  });
  return 0;
}
