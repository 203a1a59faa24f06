// Formats that only libraries read which a damaged file can crash: whatever the file, the run goes on.
#include "tests/support/files/outside_parsers.h"

#include <glm/geometric.hpp>

#include "sim/scene/readers/assimp_reader.h"

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

// The same triangles as without the other process: positions bit for bit, names and order.
TEST(X_OutsideParsers, TheOtherProcessChangesNoBit) {
  const TempFolder folder;
  for (const auto& [name, bytes] : small_meshes()) {
    const std::string file = folder.write(name, bytes);
    TriangleMesh there, here;
    MeshBuilder far(file, there), near(file, here);
    read_with_assimp(file, glm::dmat4(1), far);
    for (const MeshPart& part : read_parts_with_assimp(file))
      near.append(part.object, part.material, part.to_file, part.positions, part.corners);
    far.finish();
    near.finish();
    ASSERT_FALSE(there.triangles.empty()) << name;
    EXPECT_EQ(hash_of(there), hash_of(here)) << name;
  }
}

TEST(X_OutsideParsers, PartsThatCannotBeAreRefused) {
  MeshPart part{"wall", "brick", glm::dmat4(1), {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {0, 1, 2}};
  const std::string bytes = encode_parts({part, part});
  ASSERT_EQ(decode_parts(bytes, "a.obj").size(), 2u);
  EXPECT_EQ(decode_parts(bytes, "a.obj")[1].positions, part.positions);
  for (std::size_t size = 0; size < bytes.size(); ++size)
    EXPECT_THROW(decode_parts(std::string_view(bytes).substr(0, size), "a.obj"), InputError) << size;
  EXPECT_THROW(decode_parts(bytes + "x", "a.obj"), InputError);
  for (std::uint32_t number = 0; number < 2000; ++number) {  // decodes, is refused by the decoder, or by the builder
    try {
      TriangleMesh mesh;
      MeshBuilder builder("a.obj", mesh);
      for (const MeshPart& read : decode_parts(mutated(bytes, number), "a.obj"))
        builder.append(read.object, read.material, read.to_file, read.positions, read.corners);
      builder.finish();
      for (const glm::uvec3 corners : mesh.triangles)
        for (int c = 0; c < 3; ++c) ASSERT_LT(corners[c], mesh.vertices.size());
    } catch (const InputError& error) {
      EXPECT_EQ(std::string_view(error.what()).substr(0, 7), "a.obj: ");
    }
  }
}

}  // namespace
}  // namespace earshot
