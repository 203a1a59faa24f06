#include "sim/scene/mesh_import.h"

#include <assimp/DefaultIOSystem.h>
#include <assimp/MemoryIOWrapper.h>
#include <assimp/mesh.h>
#include <assimp/scene.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <assimp/Importer.hpp>
#include <cmath>
#include <glm/ext/matrix_transform.hpp>
#include <glm/mat4x4.hpp>
#include <span>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/scene/file_coordinates.h"
#include "sim/scene/gltf_reader.h"
#include "sim/scene/mesh_builder.h"
#include "sim/scene/mesh_repair.h"
#include "sim/scene/ply_header.h"
#include "sim/scene/polygon.h"
#include "sim/scene/text_match.h"

namespace earshot {
namespace {

constexpr std::array<const char*, 5> extensions{".glb", ".gltf", ".obj", ".ply", ".stl"};

std::string folded_extension(const std::filesystem::path& path) { return fold_case(path.extension().string()); }

glm::dmat4 to_glm(const aiMatrix4x4& m) {  // Assimp's rows are GLM's columns
  return glm::dmat4(m.a1, m.b1, m.c1, m.d1, m.a2, m.b2, m.c2, m.d2, m.a3, m.b3, m.c3, m.d3, m.a4, m.b4, m.c4, m.d4);
}

std::string material_name(const aiScene& scene, const aiMesh& part) {
  aiString name;
  if (part.mMaterialIndex < scene.mNumMaterials) name = scene.mMaterials[part.mMaterialIndex]->GetName();
  return name.length ? name.C_Str() : fmt::format("material_{}", part.mMaterialIndex);
}

/// Corners of the triangles of one part.  Assimp's own triangulation trusts indices and aborts on faces without corners.
std::vector<std::uint32_t> triangle_corners(const aiMesh& part, std::span<const glm::vec3> positions, const std::string& where) {
  std::vector<std::uint32_t> corners;
  corners.reserve(3 * std::size_t{part.mNumFaces});
  std::vector<glm::vec3> polygon;
  std::vector<std::uint32_t> cut;
  for (unsigned i = 0; i < part.mNumFaces; ++i) {
    const std::span<const unsigned> face(part.mFaces[i].mIndices, part.mFaces[i].mNumIndices);
    polygon.clear();
    cut.clear();
    if (face.size() > largest_polygon) {
      throw InputError(where, fmt::format("face {} has {} corners", i, face.size()), "cut it into triangles and export it again");
    }
    for (const unsigned index : face) {
      if (index >= positions.size()) {
        throw InputError(where,
                         fmt::format("face {} of '{}' uses vertex {} of {}", i, one_line(part.mName.C_Str()), index, positions.size()),
                         "repair the mesh and export it again");
      }
      polygon.push_back(positions[index]);
    }
    triangulate_polygon(polygon, cut);  // points and lines give none
    for (const std::uint32_t corner : cut) corners.push_back(face[corner]);
  }
  return corners;
}

void append_part(const aiScene& scene, const aiMesh& part, const std::string& object, const glm::dmat4& to_world, const std::string& where,
                 MeshBuilder& builder) {
  std::vector<glm::vec3> positions(part.mNumVertices);
  for (unsigned i = 0; i < part.mNumVertices; ++i) positions[i] = {part.mVertices[i].x, part.mVertices[i].y, part.mVertices[i].z};
  builder.append(object, material_name(scene, part), to_world, positions, triangle_corners(part, positions, where));
}

/// Hands Assimp the bytes of one file from memory; what else it asks for (the material library of an OBJ) comes from disk.
class FileInMemory : public Assimp::DefaultIOSystem {
 public:
  FileInMemory(std::string path, const std::string& bytes) : path_(std::move(path)), bytes_(bytes) {}
  bool Exists(const char* path) const override { return path == path_ || DefaultIOSystem::Exists(path); }
  Assimp::IOStream* Open(const char* path, const char* mode) override {
    if (path != path_) return DefaultIOSystem::Open(path, mode);
    return new Assimp::MemoryIOStream(reinterpret_cast<const std::uint8_t*>(bytes_.data()), bytes_.size());
  }

 private:
  std::string path_;
  const std::string& bytes_;
};

/// OBJ, PLY and STL.
void read_with_assimp(const std::filesystem::path& path, const glm::dmat4& file_to_world, MeshBuilder& builder) {
  const std::string where = path.string(), extension = folded_extension(path);
  std::string bytes = read_file(path);
  const CoordinateText format = extension == ".ply"   ? CoordinateText::ply
                                : extension == ".obj" ? CoordinateText::obj
                                                      : CoordinateText::stl;
  const glm::dvec3 file_origin = prepare_coordinates(bytes, format);
  if (format == CoordinateText::ply) check_ply_header(bytes, where);
  Assimp::Importer importer;
  importer.SetIOHandler(new FileInMemory(where, bytes));  // the importer owns it
  const aiScene* scene = nullptr;
  std::string failure;
  try {
    scene = importer.ReadFile(where, 0);
    if (!scene) failure = importer.GetErrorString();
  } catch (const std::exception& thrown) {
    failure = thrown.what();
  }
  if (!scene) throw InputError(where, "cannot be read: " + one_line(failure), "check the file in a mesh viewer or export it again");
  if (!scene->mRootNode) return;

  struct Pending {
    const aiNode* node;
    glm::dmat4 to_world;
  };
  std::vector<Pending> pending{{scene->mRootNode, glm::translate(file_to_world, file_origin)}};
  while (!pending.empty()) {
    const auto [node, parent_to_world] = pending.back();
    pending.pop_back();
    const glm::dmat4 to_world = parent_to_world * to_glm(node->mTransformation);
    for (unsigned i = 0; i < node->mNumMeshes; ++i) {
      if (node->mMeshes[i] >= scene->mNumMeshes) throw InputError(where, "a node names a mesh that is not there", "export the file again");
      const aiMesh& part = *scene->mMeshes[node->mMeshes[i]];
      std::string object = node->mName.length ? node->mName.C_Str() : part.mName.C_Str();
      if (object.empty()) object = path.stem().string();
      append_part(*scene, part, object, to_world, where, builder);
    }
    for (unsigned i = node->mNumChildren; i-- > 0;) pending.push_back({node->mChildren[i], to_world});
  }
}

void warn_about_size(const TriangleMesh& mesh, double position_step_m, ImportReport& report) {
  const Bounds bounds = bounds_of(mesh);
  const glm::dvec3 size = glm::dvec3(bounds.upper) - glm::dvec3(bounds.lower);
  const double largest_m = std::max({size.x, size.y, size.z});
  if (largest_m > 500 || largest_m < 0.5) {
    report.warnings.push_back(fmt::format("the scene is {:.4g} m in size: is the unit right? (unit_m in a scene YAML)", largest_m));
  }
  if (position_step_m > 2e-6 * largest_m) {
    report.warnings.push_back(
        fmt::format("the file holds floats so far from its origin that they are exact to {:.2g} m only, in a scene of {:.4g} m: move the mesh "
                    "to the origin of the file (a node may put it back)",
                    position_step_m, largest_m));
  }
}

}  // namespace

bool is_mesh_file(const std::filesystem::path& path) {
  return std::find(extensions.begin(), extensions.end(), folded_extension(path)) != extensions.end();
}

ImportedMesh import_mesh(const std::filesystem::path& path, const MeshImportOptions& options) {
  EARSHOT_EXPECT(options.unit_m > 0);
  const std::string where = path.string();
  std::error_code error;
  if (!std::filesystem::exists(path, error)) throw InputError(where, "does not exist", "check the path of the mesh");
  if (!std::filesystem::is_regular_file(path, error)) throw InputError(where, "is not a file", "name a glb, gltf, obj, ply or stl file");
  if (!is_mesh_file(path)) throw InputError(where, "has an unknown extension", "name a glb, gltf, obj, ply or stl file");

  const double unit = options.unit_m;
  const glm::dmat4 file_to_world = options.up == MeshImportOptions::Up::z
                                       ? glm::dmat4(unit, 0, 0, 0, 0, 0, -unit, 0, 0, unit, 0, 0, 0, 0, 0, 1)
                                       : glm::dmat4(unit, 0, 0, 0, 0, unit, 0, 0, 0, 0, unit, 0, 0, 0, 0, 1);
  ImportedMesh imported;
  const std::string extension = folded_extension(path);
  MeshBuilder builder(where, imported.mesh);
  (extension == ".glb" || extension == ".gltf" ? read_gltf : read_with_assimp)(path, file_to_world, builder);
  builder.finish();
  imported.report.triangles_read = imported.mesh.triangles.size();
  if (imported.mesh.triangles.empty()) throw InputError(where, "has no triangles", "export the file with its surfaces");
  repair_mesh(imported.mesh, imported.report);
  if (imported.mesh.triangles.empty()) throw InputError(where, "has no triangle with an area", "export the file with its surfaces");
  warn_about_size(imported.mesh, builder.position_step_m(), imported.report);
  return imported;
}

}  // namespace earshot
