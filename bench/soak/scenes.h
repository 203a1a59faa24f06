// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace earshot {

/// Difficulty of a scene of a soak; the first two are ordinary.
enum class SoakKind { house, shoebox, tiny, absorbing, rigid, many_rooms, open, flutter, corridor, hall, detailed, far_away };
inline constexpr std::size_t kNumSoakKinds = 12;
inline constexpr std::array<const char*, kNumSoakKinds> kSoakKindNames{
    "house", "shoebox", "tiny", "absorbing", "rigid", "many rooms", "open", "flutter", "corridor", "hall", "detailed", "far away"};

struct SoakScene {
  std::string spec;  ///< a SCENE
  SoakKind kind = SoakKind::house;
  std::string house = {};  ///< the text after `house:` that its geometry is made of; empty: a box
};

/// `count` generated scenes: houses of 2 to 8 rooms (seven of ten) and shoeboxes, a function of (seed, index); every hard_every-th is one
/// of the hard kinds in turn (0: none):
///  - tiny: about a cupboard, large enough for one agent (the navmesh drops less than half a square metre); absorbing: walls that keep 99
///  or 100 %; rigid: that keep 0.1 or 0 %; flutter: only two opposite walls reflect;
///  - corridor: 40 m long; hall: 40 m wide; many rooms: 16; detailed: a house of small triangles;
///  - open: a house without a ceiling; far away: a house 100 km from the origin.  Both are written to `folder` as OBJ and YAML.
std::vector<SoakScene> make_soak_scenes(std::uint64_t seed, int count, int hard_every, const std::filesystem::path& folder);

}  // namespace earshot
