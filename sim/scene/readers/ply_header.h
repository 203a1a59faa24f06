#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace earshot {

/// Throws InputError unless `bytes` begins with a well-formed PLY header whose elements fit into the bytes that follow.
/// Assimp 5.2 loops for ever on a header without end and allocates whatever count it reads.
void check_ply_header(std::string_view bytes, const std::string& where);

/// Where the header ends, its last line break included; npos if it has no end.
std::size_t end_of_ply_header(std::string_view bytes);

/// Where the positions of a PLY file are.
struct PlyVertices {
  bool ascii = false, big_endian = false, doubles = false;  ///< doubles: x, y and z are of eight bytes
  std::size_t body_begin = 0;
  std::uint64_t elements_before = 0;  ///< of other kinds
  std::uint64_t count = 0;
  std::size_t num_properties = 0;
  std::array<std::size_t, 3> xyz{};  ///< which properties
  std::size_t bytes_per_vertex = 0;  ///< of a binary file
  std::array<std::size_t, 3> xyz_bytes{};
};

/// Of a header that check_ply_header lets pass; nullopt if there is no element `vertex` with x, y and z, or a list in it.
std::optional<PlyVertices> find_ply_vertices(std::string_view bytes);

}  // namespace earshot
