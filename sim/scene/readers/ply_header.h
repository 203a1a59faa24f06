// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace earshot {

/// Types of numbers in a PLY file.
enum class PlyType { int8, uint8, int16, uint16, int32, uint32, float32, float64 };
std::size_t size_of(PlyType type);

struct PlyProperty {
  std::string name;
  PlyType type{};                     ///< of the number, or of each number of the list
  std::optional<PlyType> count_type;  ///< of the length of a list
};

struct PlyElement {
  std::string name;
  std::uint64_t count = 0;
  std::vector<PlyProperty> properties;
};

struct PlyHeader {
  enum class Body { ascii, little_endian, big_endian } body{};
  std::vector<PlyElement> elements;
  std::size_t body_begin = 0;  ///< right behind the line break of end_header: a binary body may begin with any byte
  std::size_t num_lines = 0;   ///< of the header
};

/// What of a file the bytes hold.
enum class PlyPart { whole, header };

/// Reads the header of a PLY file.  Comments and obj_info may stand in any line; the first line tells how all lines of the header end
/// ("\n", "\r\n" or "\r").  Throws InputError for a header that is not well formed, and if its elements cannot fit into the bytes that
/// follow.
/// With PlyPart::header the bytes need not have a body, and its size is not looked at.
PlyHeader parse_ply_header(std::string_view bytes, const std::string& where, PlyPart part = PlyPart::whole);

/// Whether a property is the corners of a face, or a strip of triangles.
bool is_corner_list(const PlyProperty& property);

}  // namespace earshot
