// SPDX-License-Identifier: Apache-2.0
#include "sim/nav/navmesh_image.h"

#include <DetourAlloc.h>
#include <DetourNavMesh.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <utility>
#include <vector>

#include "sim/base/byte_stream.h"
#include "sim/base/errors.h"
#include "sim/nav/navmesh_impl.h"

namespace earshot {
namespace {

constexpr std::int32_t kMaxElements = 1 << 24;

/// The arrays of a Detour tile, in the order and with the alignment of dtCreateNavMeshData (DetourNavMeshBuilder.cpp).
struct Tile {
  dtMeshHeader header;
  std::vector<float> vertices;
  std::vector<dtPoly> polygons;
  std::vector<dtPolyDetail> details;
  std::vector<float> detail_vertices;
  std::vector<unsigned char> detail_triangles;  ///< [triangles][3 corners, flags]
  std::vector<dtBVNode> boxes;
};

/// Copies one array after the other.
class Arrays {
 public:
  explicit Arrays(std::string_view bytes) : bytes_(bytes) {}
  template <class T>
  bool take(std::vector<T>& values, std::int64_t count) {
    const std::size_t size = static_cast<std::size_t>(count) * sizeof(T), aligned = (size + 3) / 4 * 4;
    if (bytes_.size() < aligned) return false;
    values.resize(static_cast<std::size_t>(count));
    if (size > 0) std::memcpy(values.data(), bytes_.data(), size);
    bytes_.remove_prefix(aligned);
    return true;
  }
  [[nodiscard]] bool empty() const { return bytes_.empty(); }

 private:
  std::string_view bytes_;
};

bool all_finite(const std::vector<float>& values) {
  return std::all_of(values.begin(), values.end(), [](float value) { return std::isfinite(value) && std::fabs(value) < 1e9f; });
}

/// False if an array does not have the size that the header says.
bool read_tile(std::string_view bytes, Tile& tile) {
  if (bytes.size() < sizeof tile.header) return false;
  std::memcpy(&tile.header, bytes.data(), sizeof tile.header);
  const dtMeshHeader& h = tile.header;
  if (h.magic != DT_NAVMESH_MAGIC || h.version != DT_NAVMESH_VERSION || h.x != 0 || h.y != 0 || h.layer != 0) return false;
  for (const int count : {h.polyCount, h.vertCount, h.maxLinkCount, h.detailMeshCount, h.detailVertCount, h.detailTriCount, h.bvNodeCount})
    if (count < 0 || count > kMaxElements) return false;
  if (h.polyCount == 0 || h.detailMeshCount != h.polyCount || h.offMeshConCount != 0 || h.offMeshBase != h.polyCount) return false;
  Arrays arrays(bytes.substr((sizeof h + 3) / 4 * 4));
  std::vector<dtLink> links;  // Detour makes them anew
  return arrays.take(tile.vertices, std::int64_t{3} * h.vertCount) && arrays.take(tile.polygons, h.polyCount) &&
         arrays.take(links, h.maxLinkCount) && arrays.take(tile.details, h.detailMeshCount) &&
         arrays.take(tile.detail_vertices, std::int64_t{3} * h.detailVertCount) &&
         arrays.take(tile.detail_triangles, std::int64_t{4} * h.detailTriCount) && arrays.take(tile.boxes, h.bvNodeCount) && arrays.empty();
}

bool is_polygon(const Tile& tile, const dtPoly& polygon) {
  if (polygon.vertCount < 3 || polygon.vertCount > Surface::kMaxCorners || polygon.getType() != DT_POLYTYPE_GROUND) return false;
  for (int i = 0; i < polygon.vertCount; ++i)
    if (polygon.verts[i] >= tile.header.vertCount || polygon.neis[i] > tile.header.polyCount) return false;
  return true;
}

bool is_detail(const Tile& tile, const dtPolyDetail& detail, int corners) {
  const auto own_vertices = static_cast<std::uint64_t>(tile.header.detailVertCount);
  const auto triangles = static_cast<std::uint64_t>(tile.header.detailTriCount);
  if (std::uint64_t{detail.vertBase} + detail.vertCount > own_vertices) return false;
  if (std::uint64_t{detail.triBase} + detail.triCount > triangles) return false;
  bool has_boundary = false;  // closestPointOnPoly follows a null pointer where a polygon has none
  for (std::size_t t = detail.triBase; t < std::size_t{detail.triBase} + detail.triCount; ++t) {
    for (std::size_t i = 0; i < 3; ++i) {
      if (tile.detail_triangles[4 * t + i] >= corners + detail.vertCount) return false;
      has_boundary = has_boundary || (tile.detail_triangles[4 * t + 3] >> (2 * i) & DT_DETAIL_EDGE_BOUNDARY) != 0;
    }
  }
  return has_boundary;
}

/// A leaf names a polygon, another node says how many nodes lie below it, itself included.
bool is_box(const Tile& tile, std::size_t node) {
  const std::int64_t i = tile.boxes[node].i;
  return i >= 0 ? i < tile.header.polyCount : -i <= static_cast<std::int64_t>(tile.boxes.size() - node);
}

bool is_sound(const Tile& tile) {
  const dtMeshHeader& h = tile.header;
  for (const float value : {h.walkableHeight, h.walkableRadius, h.walkableClimb, h.bvQuantFactor})
    if (!(value >= 0 && value < 1e9f)) return false;
  for (int axis = 0; axis < 3; ++axis)
    if (!(std::fabs(h.bmin[axis]) < 1e9f && std::fabs(h.bmax[axis]) < 1e9f && h.bmin[axis] <= h.bmax[axis])) return false;
  if (!all_finite(tile.vertices) || !all_finite(tile.detail_vertices)) return false;
  for (std::size_t p = 0; p < tile.polygons.size(); ++p)
    if (!is_polygon(tile, tile.polygons[p]) || !is_detail(tile, tile.details[p], tile.polygons[p].vertCount)) return false;
  for (std::size_t node = 0; node < tile.boxes.size(); ++node)
    if (!is_box(tile, node)) return false;
  return true;
}

}  // namespace

std::string encode_navmesh(const Navmesh& navmesh) {
  const dtMeshTile& tile = navmesh.impl().tile();
  ByteWriter writer;
  writer.put_list(std::span<const unsigned char>(tile.data, static_cast<std::size_t>(tile.dataSize)));
  return writer.take();
}

Navmesh decode_navmesh(std::string_view bytes, const NavmeshConfig& config, const std::string& where) {
  validate(config);
  ByteReader reader(bytes, where, "is not a navmesh");
  const std::vector<unsigned char> data = reader.take_list<unsigned char>();
  reader.finish();
  {
    Tile tile;
    reader.check(read_tile({reinterpret_cast<const char*>(data.data()), data.size()}, tile) && is_sound(tile));
  }
  auto* owned = static_cast<unsigned char*>(dtAlloc(data.size(), DT_ALLOC_PERM));
  OwnedNavMesh mesh(dtAllocNavMesh());
  if (!owned || !mesh) {
    dtFree(owned);
    throw RunError("navmesh", "no memory for a tile");
  }
  std::memcpy(owned, data.data(), data.size());
  if (dtStatusFailed(mesh->init(owned, static_cast<int>(data.size()), DT_TILE_FREE_DATA))) {
    dtFree(owned);
    reader.fail();
  }
  return Navmesh(std::make_unique<Navmesh::Impl>(std::move(mesh), config));
}

}  // namespace earshot
