// SPDX-License-Identifier: Apache-2.0
// Point clouds through their readers (PLY without faces, PCD, LAS, XYZ), and small ones through voxels to a closed surface.
#include "fuzz/fuzz_target.h"
#include "sim/scene/point_cloud/cloud_import.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  static const fuzz::InputFile ply("cloud.ply"), pcd("cloud.pcd"), las("cloud.las"), xyz("cloud.xyz");
  std::string_view rest = fuzz::text_of(data, size);
  const unsigned choice = fuzz::take_choice(rest, 8);
  const fuzz::InputFile& file = choice % 4 == 0 ? ply : choice % 4 == 1 ? pcd : choice % 4 == 2 ? las : xyz;
  const std::filesystem::path& path = file.write(rest);
  fuzz::expect_value_or_refusal([&] {
    const PointCloud cloud = read_point_file(path);
    if (cloud.positions.empty()) fuzz::report("a cloud without points was read", path.string());
  });
  if (choice < 4) return 0;
  fuzz::expect_value_or_refusal([&] {
    const ImportedMesh imported = import_point_cloud(path, {.cell_m = 0.5});
    for (const glm::uvec3 corners : imported.mesh.triangles)
      for (int corner = 0; corner < 3; ++corner)
        if (corners[corner] >= imported.mesh.vertices.size()) fuzz::report("a triangle points nowhere", "");
  });
  return 0;
}
