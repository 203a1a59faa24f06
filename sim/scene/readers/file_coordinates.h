#pragma once

#include <glm/vec3.hpp>
#include <string>

namespace earshot {

/// Encodings of a mesh file whose positions a reader of floats would cut short.
enum class CoordinateText { obj, ply, stl };

/// Makes the bytes of an OBJ, PLY or STL file ready for a reader that keeps positions as floats.
///
/// A UTF-8 byte order mark goes, and so do the carriage returns of a PLY header.  Positions in text, and doubles in a binary PLY, that lie
/// far from zero (origin_near, in units of the file) are rewritten relative to an origin near them, in double: a float at 1e6 m is exact to
/// 6 cm only.  Returns that origin; zero if nothing was moved.  What is not understood stays as it is: the reader says what is wrong with
/// it. Binary STL and float PLY hold no more digits than a float: they stay too.
glm::dvec3 prepare_coordinates(std::string& bytes, CoordinateText format);

}  // namespace earshot
