// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <limits>
#include <memory>
#include <span>

namespace earshot {

/// Nearest hit of one ray.  `triangle == no_triangle` means that the ray left the scene.
struct Hit {
  static constexpr std::uint32_t no_triangle = 0xFFFFFFFFu;
  float distance_m = std::numeric_limits<float>::infinity();
  /// On the triangle (barycentric, not origin + t * direction: smaller error) and a few roundings inside its edges, metres.
  glm::vec3 position{0};
  glm::vec3 normal{0};                   ///< unit, geometric, turned toward the ray's origin
  std::uint32_t triangle = no_triangle;  ///< of the mesh; where other triangles are traced, the one that stands_for the hit
  [[nodiscard]] bool valid() const { return triangle != no_triangle; }
};

/// A point moved off a surface along `normal` (unit) by a few units in the last place, so that a ray started there cannot
/// hit the surface it starts on, at any scale (Waechter and Binder, Ray Tracing Gems 2019, chapter 6).
glm::vec3 offset_from_surface(glm::vec3 position, glm::vec3 normal);

/// Unit directions of a packet of rays, by coordinate.
struct Directions16 {
  alignas(64) std::array<float, 16> x, y, z;
};

/// A static triangle soup ready for ray queries.  Immutable after construction and safe from any thread.
/// An empty soup is valid: every ray escapes.
class EmbreeScene {
 public:
  /// vertices [n] metres, triangles [m] indices into vertices (checked by the caller).  Copies both.
  /// Throws InputError if Embree cannot be opened, with its own message.  Cost: about 0.5 s per million triangles.
  EmbreeScene(std::span<const glm::vec3> vertices, std::span<const glm::uvec3> triangles);
  /// Traces other triangles than those it reports: `traced` [k] is the surface of a mesh in another triangulation, and a hit on traced[i]
  /// is reported as triangle stands_for[i] of that mesh.  "The lowest index" of intersect is that of `traced`.  Copies all three.
  EmbreeScene(std::span<const glm::vec3> vertices, std::span<const glm::uvec3> traced, std::span<const std::uint32_t> stands_for);
  ~EmbreeScene();
  EmbreeScene(EmbreeScene&&) noexcept;
  EmbreeScene& operator=(EmbreeScene&&) noexcept;

  /// direction: unit.  Hits with distance in (0, max_distance_m); surfaces within half the spacing of floats of the origin are not hit.
  /// An origin beyond 1e15 m, or NaN in origin or direction, gives no hit.  About 0.2 to 0.8 us.  Among parallel triangles that lie within
  /// 1e-6 of the coordinates of each other (coplanar overlap) the lowest index wins, from every direction.
  [[nodiscard]] Hit intersect(glm::vec3 origin, glm::vec3 direction, float max_distance_m = std::numeric_limits<float>::infinity()) const;
  /// Whether the open segment from -> to is blocked.  A surface on which an end lies exactly does not block; rounded points of tilted
  /// surfaces must have been moved by offset_from_surface.  True if an end is NaN or beyond 1e15 m. The same answer, bit for bit, with the
  /// ends swapped.
  [[nodiscard]] bool occluded(glm::vec3 from, glm::vec3 to) const;
  /// The same answer, sooner where `blocker` is right.  blocker: in, the traced triangle that may block the segment, Hit::no_triangle or
  /// any other number: it is tested first, in about 10 ns.  Out: the triangle that blocked it, unchanged if none did.
  [[nodiscard]] bool occluded(glm::vec3 from, glm::vec3 to, std::uint32_t& blocker) const;
  /// Eight coherent rays at once (camera rows): distances only, infinity where a ray escapes.  About 0.8 us for all eight.
  void intersect8(std::span<const glm::vec3, 8> origins, std::span<const glm::vec3, 8> directions, std::span<float, 8> distances_m) const;
  /// Sixteen rays from one point, of neighbouring pixels in a block of 4 x 4: distances only, infinity where a ray escapes.  The bits of
  /// intersect8; about 0.7 us for all sixteen with AVX-512, twice that without.
  void intersect16(glm::vec3 origin, const Directions16& directions, std::span<float, 16> distances_m) const;
  /// The same rays with all that they meet; the distances have the same bits.  Of coplanar overlaps either may win, not the lowest index
  /// as with intersect.
  void intersect16(glm::vec3 origin, const Directions16& directions, std::span<Hit, 16> hits) const;
  /// Number of traced triangles.
  [[nodiscard]] std::size_t num_triangles() const;
  /// Triangles of the scene, to build it again: [k] indices into vertices, valid while this lives.
  [[nodiscard]] std::span<const glm::uvec3> traced() const;
  /// The triangle that a hit on this traced one is reported as.
  [[nodiscard]] std::uint32_t stands_for(std::uint32_t traced) const;
  /// Memory it holds: what Embree counts of its buffers and its tree, and the data of hits.
  [[nodiscard]] std::size_t bytes() const;

 private:
  struct Handles;
  std::unique_ptr<Handles> handles_;
};

}  // namespace earshot
