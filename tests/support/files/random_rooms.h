// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>

#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "sim/base/random.h"
#include "tests/support/files/mesh_cases.h"

/// Closed box rooms of random sizes and places, and files that hold them in ways that real files take; knows nothing of the readers.
namespace earshot::random_rooms {

/// Draws of one test; the same number gives the same draws.
class Draws {
 public:
  Draws(std::uint32_t test, std::uint32_t number) : random_(20261127, Purpose::test, number, test) {}
  std::uint32_t below(std::size_t count) { return random_.below(static_cast<std::uint32_t>(count), next_++); }
  /// In whole hundredths: the text of a coordinate is exact.
  double between(double lower, double upper) {
    return std::round(100 * lower) / 100 + 0.01 * below(static_cast<std::size_t>(std::lround(100 * (upper - lower)) + 1));
  }
  bool coin() { return below(2) == 1; }

 private:
  RandomStream random_;
  std::uint32_t next_ = 0;
};

struct Room {
  glm::dvec3 size_m{0}, lower{0};
  mesh_cases::DoubleMesh mesh;
  [[nodiscard]] double volume_m3() const { return size_m.x * size_m.y * size_m.z; }
};

inline Room room(Draws& draws) {
  Room made;
  made.size_m = {draws.between(2, 9), draws.between(2, 4), draws.between(2, 9)};
  made.lower = {draws.between(-3, 3), draws.between(-1, 1), draws.between(-3, 3)};
  made.mesh = mesh_cases::box(made.size_m, made.lower);
  return made;
}

/// A comment as people write them: numbers, words, number signs, a backslash at its end.
inline std::string comment(Draws& draws) {
  constexpr std::array texts{"corner 1 of 8", "wall", "3.5 m", "# 12 / 7", "f 1 2 3", "v 0 0 0", "C:\\rooms\\", "1/1/1", "end_header"};
  return texts[draws.below(texts.size())];
}

/// Bytes of numbers in either order.
class Binary {
 public:
  explicit Binary(bool is_big_endian) : is_big_endian_(is_big_endian) {}
  template <class T>
  void add(T value) {
    auto raw = std::bit_cast<std::array<char, sizeof value>>(value);
    if (is_big_endian_) std::reverse(raw.begin(), raw.end());
    bytes.append(raw.data(), raw.size());
  }
  std::string bytes;

 private:
  bool is_big_endian_;
};

/// The six walls of a box as two triangles each: corners a b c d of which a strip makes both triangles.
inline std::vector<std::array<int, 4>> wall_strips() {
  return {{0, 1, 4, 5}, {2, 6, 3, 7}, {0, 2, 1, 3}, {4, 5, 6, 7}, {0, 4, 2, 6}, {1, 3, 5, 7}};
}

/// Each line of a PLY header may be followed by a comment.
inline std::string with_comments(const std::string& ply, Draws& draws) {
  const std::size_t end = ply.find("end_header");
  std::string text = ply.substr(0, ply.find('\n') + 1);
  for (std::size_t begin = text.size(); begin < end;) {
    const std::size_t next = ply.find('\n', begin) + 1;
    if (draws.coin()) text += draws.coin() ? "comment " + comment(draws) + "\n" : draws.coin() ? "comment\n" : "obj_info num_cols 512\n";
    text += ply.substr(begin, next - begin);
    begin = next;
  }
  return text + "comment behind the last element\n" + ply.substr(end);
}

}  // namespace earshot::random_rooms
