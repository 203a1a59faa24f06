// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/finite_edge.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>

#include "sim/acoustics/paths/fast_angles.h"

namespace earshot {
namespace {

/// Two terms of the series by parts are good from here on.
constexpr float kFar = 2.75f;

/// Far from overflow: a tenth of the time of std::hypot.
double length_of(double x, double y) { return std::sqrt(x * x + y * y); }

/// exp(j u^2) times the integral of exp(-j t^2) from u on.
ComplexLanes fresnel_tail(const ComplexLanes& end_erfc) {
  constexpr float half = 0.5f / std::numbers::inv_sqrtpi_v<float> * std::numbers::sqrt2_v<float> / 2;
  return ComplexLanes{all_lanes(half), all_lanes(-half)} * end_erfc;
}

/// (1 / pi) times the integral over x from 0 to low / high of exp(j low^2 - j (high x)^2) / (1 + x^2), low <= high, low <= kFar: Owen's T
/// function (Owen 1956, Ann. Math. Statist. 27, 1075-1090) of an argument on the ray exp(j pi / 4).  turn: exp(j low^2); erfc:
/// scaled_erfc(low).  With x = t low / high and 1 / (1 + y) as a polynomial (2.2e-4 at most) it is a sum of moments
/// M_k = integral of t^2k exp(j low^2 (1 - t^2)) from 0 to 1, of which 2 j low^2 M_k+1 = (2 k + 1) M_k - 1.
ComplexLanes owen_t(const Lanes& low, const Lanes& high, const ComplexLanes& turn, const ComplexLanes& erfc) {
  constexpr std::size_t degree = 4;
  constexpr std::array<float, degree + 1> coefficient = {0.99978336f, -0.98729908f, 0.87791824f, -0.55180617f, 0.16162028f};
  constexpr float split = 0.84f;  // below it the recurrence is stable downward, above it upward
  const LaneIntegers small = low < split;
  const Lanes below = small ? low : all_lanes(split), above = small ? all_lanes(split) : low;
  std::array<ComplexLanes, degree + 1> moment;
  const Lanes twice = 2.f * below * below, guess = 1.f / (169.f + twice * twice);
  ComplexLanes down = {13.f * guess, twice * guess};  // M_6 where M_7 is about as large
  for (std::size_t k = 6; k-- > 0;) {
    const float per_step = 1.f / static_cast<float>(2 * k + 1);
    down = {per_step * (1.f - twice * down.imag), per_step * (twice * down.real)};
    if (k <= degree) moment[k] = down;
  }
  const Lanes half = 0.5f / (above * above);
  // M_0 by the complementary error function: the rest of exp(j low^2) times the integral of exp(-j t^2) over the half line.
  const ComplexLanes rest = (0.62665707f / above) * (turn - erfc);
  ComplexLanes up = {rest.real + rest.imag, rest.imag - rest.real};
  for (std::size_t k = 0;; ++k) {
    moment[k] = choose(small, moment[k], up);
    if (k == degree) break;
    const auto odd = static_cast<float>(2 * k + 1);
    up = {half * (odd * up.imag), half * (1.f - odd * up.real)};
  }
  const Lanes fraction = low / (high < 1e-20f ? all_lanes(1e-20f) : high), square = fraction * fraction;
  ComplexLanes sum = all_lanes(coefficient[degree]) * moment[degree];
  for (std::size_t k = degree; k-- > 0;) sum = square * sum + all_lanes(coefficient[k]) * moment[k];
  return (std::numbers::inv_pi_v<float> * fraction) * sum;
}

}  // namespace

ComplexLanes edge_tail(const Lanes& u, const Lanes& b, const ComplexLanes& own_erfc, const ComplexLanes& end_erfc, float least_u) {
  // By parts, twice: -j w (1 + j next), w = b / (2 pi u (u^2 + b^2)).
  const Lanes above = u < kFar ? all_lanes(kFar) : u, square = above * above + b * b;
  const Lanes w = b / ((2.f * std::numbers::pi_v<float>)*above * square), next = 0.5f / (above * above) + 1.f / square;
  const ComplexLanes far = {w * next, -w};
  if (least_u >= kFar) return far;
  // The rest of the line by T; where b is the smaller one, T of the swapped arguments (Owen 1956), so that the integral is short.
  const Lanes below = u < kFar ? u : all_lanes(kFar);
  const LaneIntegers swapped = b < below;
  const Lanes low = choose(swapped, b, below), high = choose(swapped, below, b);
  const ComplexLanes turn = unit_phase(low * low), t = owen_t(low, high, turn, choose(swapped, own_erfc, end_erfc));
  const ComplexLanes near = choose(swapped, t - all_lanes(0.5f) * (end_erfc * (turn - own_erfc)), all_lanes(0.5f) * (turn * own_erfc) - t);
  return choose(u < kFar, near, far);
}

double largest_ratio(const DiffractionEdge& edge, glm::dvec3 before, glm::dvec3 after) {
  const glm::dvec3 from_source = before - edge.start, from_listener = after - edge.start;
  const double source_z = glm::dot(from_source, edge.along), listener_z = glm::dot(from_listener, edge.along);
  const double source_r = glm::length(from_source - source_z * edge.along),
               listener_r = glm::length(from_listener - listener_z * edge.along);
  const double shortest_m = length_of(source_r + listener_r, source_z - listener_z), across = source_r + listener_r;
  if (!(shortest_m > 0) || !(across > 0)) return 2.0;
  const double apex_z = (source_z * listener_r + listener_z * source_r) / across;
  const auto root_of_detour = [&](double z) {
    const double detour_m = length_of(source_r, z - source_z) + length_of(listener_r, z - listener_z) - shortest_m;
    return std::copysign(std::sqrt(std::max(detour_m, 0.0)), z - apex_z);
  };
  const double low = root_of_detour(0), high = root_of_detour(edge.length_m);
  const WedgeDiffraction wedge(edge.exterior_rad, edge.angle_of(before), edge.angle_of(after));
  const double scale = std::sqrt(2.0 * source_r * listener_r / shortest_m);
  double sum = 0;
  for (std::size_t term = 0; term < 4; ++term) {
    const double b = scale * wedge.boundary(term);
    sum += std::abs(wedge.weight(term)) * (fast_atan2(high, b) - fast_atan2(low, b));
  }
  return sum / std::numbers::pi;
}

FiniteWedge::FiniteWedge(const DiffractionEdge& edge, glm::dvec3 before, glm::dvec3 after)
    : FiniteWedge(edge, before, after, edge.angle_of(before), edge.angle_of(after)) {}

FiniteWedge::FiniteWedge(const DiffractionEdge& edge, glm::dvec3 before, glm::dvec3 after, double before_rad, double after_rad)
    : wedge_(edge.exterior_rad, before_rad, after_rad) {
  const glm::dvec3 from_source = before - edge.start, from_listener = after - edge.start;
  const double source_z = glm::dot(from_source, edge.along), listener_z = glm::dot(from_listener, edge.along);
  const double source_r = glm::length(from_source - source_z * edge.along),
               listener_r = glm::length(from_listener - listener_z * edge.along);
  const double shortest_m = length_of(source_r + listener_r, source_z - listener_z);
  if (!(shortest_m > 0)) return;
  own_length_m_ = source_r * listener_r / shortest_m;
  const double across = source_r + listener_r;
  const double apex_z = across > 0 ? (source_z * listener_r + listener_z * source_r) / across : 0.5 * edge.length_m;
  past_end_ = apex_z < 0 ? 0 : apex_z > edge.length_m ? 1 : -1;
  const double nu = std::numbers::pi / edge.exterior_rad;
  const FourPhases beta = fast_unit_phase(  // exp(j nu d)
      nu * FourNumbers{wedge_.from_boundary(0), wedge_.from_boundary(1), wedge_.from_boundary(2), wedge_.from_boundary(3)});
  for (std::size_t i = 0; i < 2; ++i) {
    const double z = i == 0 ? 0.0 : edge.length_m;
    const double m = length_of(source_r, z - source_z), l = length_of(listener_r, z - listener_z);
    ends_[i].detour_m = std::max(m + l - shortest_m, 0.0);
    const double slope = m > 0 && l > 0 ? std::abs((z - source_z) / m + (z - listener_z) / l) : 0.0;
    ends_[i].root_of_detour = std::sqrt(ends_[i].detour_m);
    if (!(ends_[i].detour_m > 1e-9 * shortest_m) || !(slope > 1e-9) || !(source_r * listener_r > 1e-9 * shortest_m * shortest_m)) continue;
    const double cosh_eta = (m * l + (z - source_z) * (z - listener_z)) / (source_r * listener_r);
    // cosh(nu arcosh(cosh_eta)).
    const double above = std::max(cosh_eta, 1.0), raised = std::pow(above + std::sqrt(above * above - 1.0), nu);
    const double cosh_nu_eta = 0.5 * (raised + 1.0 / raised);
    const double spreading = nu * shortest_m / (4.0 * std::numbers::pi) / (m * l) * 2.0 * ends_[i].root_of_detour / slope;
    for (std::size_t term = 0; term < 4; ++term) {
      const double theory = wedge_.weight(term) * std::sqrt(2.0 * own_length_m_) * wedge_.boundary(term) /
                            (std::numbers::pi * (ends_[i].detour_m + 2.0 * own_length_m_ * wedge_.boundary(term) * wedge_.boundary(term)));
      const double below = cosh_nu_eta - beta.cosine[term];
      ends_[i].residue[term] = below > 1e-12 ? -spreading * beta.sine[term] / below - theory : 0.0;
    }
  }
}

ComplexLanes FiniteWedge::ratio(const WaveLanes& wave, double length_m, const FaceFactorLanes& faces) const {
  struct Tail {
    Lanes u;
    float least_u;
    ComplexLanes erfc, turn, fresnel;
  };
  std::array<Tail, 2> tails;
  for (std::size_t i = 0; i < 2; ++i) {
    Tail& tail = tails[i];
    tail.u = wave.root * static_cast<float>(ends_[i].root_of_detour);
    tail.least_u = tail.u[0];
    tail.erfc = scaled_erfc(tail.u);
    tail.turn = wave.turn(ends_[i].detour_m);
    tail.fresnel = (1.f / wave.root) * fresnel_tail(tail.erfc);
  }
  // The part of the endless edge beyond the ends; past an end, the part between them.  Sums at each end, over all terms.
  const std::array<const Lanes*, 4> face = {&faces.incidence, &faces.incidence, &faces.first, &faces.second};
  const Lanes scale = wave.root * static_cast<float>(std::sqrt(2.0 * length_m));
  ComplexLanes whole;
  std::array<ComplexLanes, 2> end{};
  for (std::size_t term = 0; term < 4; ++term) {
    if (all_zero(*face[term])) continue;
    const Lanes weight = static_cast<float>(wedge_.weight(term)) * *face[term], b = scale * static_cast<float>(wedge_.boundary(term));
    const ComplexLanes erfc = scaled_erfc(b);
    whole = whole + weight * erfc;
    for (std::size_t i = 0; i < 2; ++i) {
      const Tail& tail = tails[i];
      end[i] = end[i] + weight * edge_tail(tail.u, b, erfc, tail.erfc, tail.least_u) +
               (static_cast<float>(ends_[i].residue[term]) * *face[term]) * tail.fresnel;
    }
  }
  ComplexLanes sum;
  if (past_end_ < 0) {
    sum = whole - end[0] * conj(tails[0].turn) - end[1] * conj(tails[1].turn);
  } else {
    const auto near = static_cast<std::size_t>(past_end_), far = 1 - near;
    sum = end[near] - end[far] * (conj(tails[far].turn) * tails[near].turn);
  }
  // As the endless edge, at most twice the free field.
  const Lanes square = norm(sum);
  const Lanes most = choose(square > 4.f, square, all_lanes(4.f));
  return all_zero(most - 4.f) ? sum : (2.f / root_of(most)) * sum;
}

}  // namespace earshot
