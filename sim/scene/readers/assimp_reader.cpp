#include "sim/scene/readers/assimp_reader.h"

#include <assimp/DefaultIOSystem.h>
#include <assimp/MemoryIOWrapper.h>
#include <assimp/material.h>
#include <assimp/mesh.h>
#include <assimp/scene.h>
#include <fmt/format.h>

#include <assimp/Importer.hpp>
#include <cmath>
#include <glm/ext/matrix_transform.hpp>
#include <span>

#include "sim/base/byte_stream.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/process/isolated_call.h"
#include "sim/base/text/text_match.h"
#include "sim/scene/mesh/polygon.h"
#include "sim/scene/readers/file_coordinates.h"
#include "sim/scene/readers/ply_header.h"

namespace earshot {
namespace {

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

MeshPart make_part(const aiScene& scene, const aiMesh& part, std::string object, const glm::dmat4& to_file, const std::string& where) {
  std::vector<glm::vec3> positions(part.mNumVertices);
  for (unsigned i = 0; i < part.mNumVertices; ++i) positions[i] = {part.mVertices[i].x, part.mVertices[i].y, part.mVertices[i].z};
  std::vector<std::uint32_t> corners = triangle_corners(part, positions, where);
  return {std::move(object), material_name(scene, part), to_file, std::move(positions), std::move(corners)};
}

/// Numbers of a damaged file may be anything.
float finite_or_zero(float value) { return std::isfinite(value) ? value : 0.f; }

/// has_materials: the file has a library of them.  Without one Assimp makes them up, with a grey of its own.
void add_looks(const aiScene& scene, const aiMesh& from, bool has_materials, MeshPart& part) {
  if (from.HasTextureCoords(0)) {
    for (unsigned i = 0; i < from.mNumVertices; ++i)
      part.uvs.emplace_back(finite_or_zero(from.mTextureCoords[0][i].x), finite_or_zero(from.mTextureCoords[0][i].y));
  }
  if (from.HasVertexColors(0)) {
    for (unsigned i = 0; i < from.mNumVertices; ++i) {
      const aiColor4D color = from.mColors[0][i];
      part.colors.emplace_back(finite_or_zero(color.r), finite_or_zero(color.g), finite_or_zero(color.b));
    }
  }
  if (!has_materials || from.mMaterialIndex >= scene.mNumMaterials) return;
  const aiMaterial& material = *scene.mMaterials[from.mMaterialIndex];
  aiColor3D diffuse;
  if (material.Get(AI_MATKEY_COLOR_DIFFUSE, diffuse) == aiReturn_SUCCESS)
    part.base_color = {{finite_or_zero(diffuse.r), finite_or_zero(diffuse.g), finite_or_zero(diffuse.b)}};
  aiString file;
  if (material.GetTexture(aiTextureType_DIFFUSE, 0, &file) == aiReturn_SUCCESS) part.texture = file.C_Str();
}

/// Gives Assimp the bytes of one file from memory; other files that it opens (the material library of an OBJ) come from disk.
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

}  // namespace

std::vector<MeshPart> read_parts_with_assimp(const std::filesystem::path& path, bool with_looks) {
  const std::string where = path.string(), extension = fold_case(path.extension().string());
  std::string bytes = read_file(path);
  const CoordinateText format = extension == ".ply" ? CoordinateText::ply : extension == ".obj" ? CoordinateText::obj : CoordinateText::stl;
  const glm::dvec3 file_origin = prepare_coordinates(bytes, format);
  if (format == CoordinateText::ply) check_ply_header(bytes, where);
  const bool has_materials = format == CoordinateText::obj && bytes.find("mtllib") != std::string::npos;
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
  std::vector<MeshPart> parts;
  if (!scene->mRootNode) return parts;

  struct Pending {
    const aiNode* node;
    glm::dmat4 to_file;
  };
  std::vector<Pending> pending{{scene->mRootNode, glm::translate(glm::dmat4(1), file_origin)}};
  while (!pending.empty()) {
    const auto [node, parent_to_file] = pending.back();
    pending.pop_back();
    const glm::dmat4 to_file = parent_to_file * to_glm(node->mTransformation);
    for (unsigned i = 0; i < node->mNumMeshes; ++i) {
      if (node->mMeshes[i] >= scene->mNumMeshes) throw InputError(where, "a node names a mesh that is not there", "export the file again");
      const aiMesh& part = *scene->mMeshes[node->mMeshes[i]];
      std::string object = node->mName.length ? node->mName.C_Str() : part.mName.C_Str();
      if (object.empty()) object = path.stem().string();
      parts.push_back(make_part(*scene, part, std::move(object), to_file, where));
      if (with_looks) add_looks(*scene, part, has_materials, parts.back());
    }
    for (unsigned i = node->mNumChildren; i-- > 0;) pending.push_back({node->mChildren[i], to_file});
  }
  return parts;
}

void read_with_assimp(const std::filesystem::path& path, const glm::dmat4& file_to_world, MeshBuilder& builder) {
  const std::string where = path.string();
  const std::string answer = call_isolated(reader_program(), {"mesh", where}, where, limits_for_file(path));
  for (const MeshPart& part : decode_parts(answer, where))
    builder.append(part.object, part.material, file_to_world * part.to_file, part.positions, part.corners);
}

std::vector<MeshPart> read_visual_parts(const std::filesystem::path& path) {
  const std::string where = path.string();
  return decode_parts(call_isolated(reader_program(), {"visual", where}, where, limits_for_file(path)), where);
}

std::string encode_parts(const std::vector<MeshPart>& parts) {
  ByteWriter writer;
  writer.put(static_cast<std::uint64_t>(parts.size()));
  for (const MeshPart& part : parts) {
    writer.put_text(part.object);
    writer.put_text(part.material);
    writer.put(part.to_file);
    writer.put_list(part.positions);
    writer.put_list(part.corners);
    writer.put_list(part.uvs);
    writer.put_list(part.colors);
    writer.put_list(part.base_color);
    writer.put_text(part.texture);
  }
  return writer.take();
}

std::vector<MeshPart> decode_parts(std::string_view bytes, const std::string& where) {
  ByteReader reader(bytes, where);
  std::vector<MeshPart> parts;
  for (auto left = reader.take<std::uint64_t>(); left > 0; --left) {
    MeshPart part;
    part.object = reader.take_text();
    part.material = reader.take_text();
    part.to_file = reader.take<glm::dmat4>();
    part.positions = reader.take_list<glm::vec3>();
    part.corners = reader.take_list<std::uint32_t>();
    part.uvs = reader.take_list<glm::vec2>();
    part.colors = reader.take_list<glm::vec3>();
    part.base_color = reader.take_list<glm::vec3>();
    part.texture = reader.take_text();
    parts.push_back(std::move(part));
  }
  reader.finish();
  return parts;
}

}  // namespace earshot
