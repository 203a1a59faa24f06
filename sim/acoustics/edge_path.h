#pragma once

#include <array>
#include <complex>
#include <cstdint>
#include <glm/vec3.hpp>

#include "sim/acoustics/diffraction_edges.h"
#include "sim/acoustics/utd.h"

namespace earshot {

inline constexpr int kMaxDiffractionOrder = 10;

/// The edges that a path goes over, in order.
struct EdgeSequence {
  std::array<std::uint32_t, kMaxDiffractionOrder> edge{};
  int order = 0;
};

/// The point of the line through the edge by which the way from a to b is shortest (equal angles with the edge on both sides), as a
/// distance from the edge's start; not limited to the edge.  On the line itself: the middle of the edge.
double fermat_point(const DiffractionEdge& edge, glm::dvec3 a, glm::dvec3 b);

/// The shortest way from `from` over the edges to `to` (Fermat): exact for one edge, by Newton's method on the convex length for several.
struct EdgePath {
  EdgeSequence sequence;
  glm::dvec3 from{0}, to{0};
  std::array<double, kMaxDiffractionOrder> along_m{};  ///< on each edge, between its ends
  std::array<glm::dvec3, kMaxDiffractionOrder> point{};
  std::array<bool, kMaxDiffractionOrder> at_end{};  ///< the shortest way would have met the edge's line past its end
  double length_m = 0;                              ///< of the way by these points
  double beyond_m = 0;                              ///< how much longer that is than the shortest over the edges' lines
};
/// False if the points of two edges coincide, as at a corner where they meet.
bool shortest_path(const DiffractionEdges& edges, const EdgeSequence& sequence, glm::dvec3 from, glm::dvec3 to, EdgePath& path);

/// Field of a path over the free field at its length: the product of the wedges' ratios (utd.h).
///
/// Several edges: the wedge that bends the path least takes L from the legs next to it, is then left out, and so on; the last takes L
/// from the whole path, as in Deygout's construction.  Far from all boundaries the product is Keller's with the exact spreading, at any
/// one boundary it joins the path that skips this edge, it never diverges for edges close together, and it is reciprocal.  It is
/// wrong where several edges are at their boundaries at once: two black edges in one line with both ends leave 1/4 instead of 1/3 of the
/// pressure (2.5 dB).
///
/// A leg along the common face of two edges: incident and reflected ray coincide, and the field is divided by 1 + R of that face (K-P 1974
/// for grazing incidence: half for a rigid face).  Two rims of one sheet have no such leg: not a valid path.
///
/// Past an edge's end the ratio fades with the detour by way of the end, as behind a second knife edge, and loses its jump at
/// boundaries; at the end itself it is not yet reduced (up to 6 dB too much there; Kirchhoff's corner has half).
class EdgePathField {
 public:
  EdgePathField(const DiffractionEdges& edges, const EdgePath& path);
  /// False if a leg runs inside a wedge or along a sheet from rim to rim.
  [[nodiscard]] bool valid() const { return valid_; }
  /// reflection(material): pressure reflection factor of a face.
  template <class Reflection>
  [[nodiscard]] std::complex<double> ratio(double wavenumber, const Reflection& reflection) const {
    std::complex<double> product = 1;
    for (int i = 0; i < order_; ++i) {
      const Wedge& wedge = wedges_[static_cast<std::size_t>(i)];
      const double first = reflection(wedge.first_material), second = reflection(wedge.second_material);
      const std::complex<double> own = wedge.diffraction.ratio(wavenumber * wedge.length_m, first, second,
                                                               wedge.beyond_m > 0 ? std::sqrt(wavenumber * wedge.beyond_m) : 0.0);
      product = {product.real() * own.real() - product.imag() * own.imag(), product.real() * own.imag() + product.imag() * own.real()};
      if (wedge.shares_next) product /= 1.0 + 0.5 * (reflection(wedge.shared_material) + reflection(wedge.next_shared_material));
    }
    return product;
  }

 private:
  struct Wedge {
    WedgeDiffraction diffraction;
    double length_m = 0, beyond_m = 0;
    std::uint32_t first_material = 0, second_material = 0;
    bool shares_next = false;  ///< the leg to the next edge lies in a face of both
    std::uint32_t shared_material = 0, next_shared_material = 0;
  };
  int order_ = 0;
  bool valid_ = true;
  std::array<Wedge, kMaxDiffractionOrder> wedges_;
};

}  // namespace earshot
