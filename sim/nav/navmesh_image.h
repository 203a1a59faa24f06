// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "sim/nav/navmesh.h"

namespace earshot {

/// A navmesh as bytes, for a file that the next process reads in place of building it: the Detour tile.  Native order; the caller keeps
/// the version, the config and the identity of the mesh.
std::string encode_navmesh(const Navmesh& navmesh);

/// The same navmesh: every query gives the same bits.  config: that of the navmesh that was encoded.  Detour trusts its tiles, so sizes,
/// indices and numbers are checked first: an invalid image throws InputError naming `where`.  About 1 ms for a house.
Navmesh decode_navmesh(std::string_view bytes, const NavmeshConfig& config, const std::string& where);

}  // namespace earshot
