#pragma once

#include <string>
#include <string_view>

namespace earshot {

/// Throws InputError unless `bytes` begins with a well-formed PLY header whose elements fit into the bytes that follow.
/// Assimp 5.2 loops for ever on a header without end and allocates whatever count it reads.
void check_ply_header(std::string_view bytes, const std::string& where);

}  // namespace earshot
