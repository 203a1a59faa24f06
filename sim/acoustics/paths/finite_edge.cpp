#include "sim/acoustics/paths/finite_edge.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <vector>

#include "sim/acoustics/paths/fast_angles.h"

namespace earshot {
namespace {

constexpr double kPi = std::numbers::pi, kNear = 3.0;

using Complex = std::complex<double>;

Complex times(Complex a, Complex b) { return {a.real() * b.real() - a.imag() * b.imag(), a.real() * b.imag() + a.imag() * b.real()}; }
/// Far from overflow: a tenth of the time of std::hypot.
double length_of(double x, double y) { return std::sqrt(x * x + y * y); }

/// b times the integral of (exp(-j t^2) - exp(j b^2)) / (t^2 + b^2) over t from 0 to u: an entire function, as the pole is divided out.
/// Cubic between points a sixteenth apart, for u, b up to kNear.
class SmoothPart {
 public:
  static constexpr double kPerUnit = 16.0;
  static constexpr std::size_t kMargin = 1, kPoints = static_cast<std::size_t>(kNear * kPerUnit) + 2 * kMargin + 2;
  SmoothPart() : value_(kPoints * kPoints) {
    for (std::size_t row = 0; row < kPoints; ++row) {
      const double b = (static_cast<double>(row) - kMargin) / kPerUnit;
      const Complex pole = fast_unit_phase(b * b);
      const auto integrand = [&](double t) {
        const double below = t * t + b * b;
        return below > 1e-12 ? b * (fast_unit_phase(-t * t) - pole) / below : Complex(0, -b);
      };
      for (const int side : {1, -1}) {
        Complex sum = 0;
        value_[row * kPoints + kMargin] = 0;
        for (std::size_t column = kMargin; side > 0 ? column + 1 < kPoints : column > 0; column += static_cast<std::size_t>(side)) {
          // Simpson over four pieces of each step.
          const double from = (static_cast<double>(column) - kMargin) / kPerUnit, h = side / kPerUnit / 8;
          for (int piece = 0; piece < 4; ++piece) {
            const double t = from + 2 * piece * h;
            sum += h / 3 * (integrand(t) + 4.0 * integrand(t + h) + integrand(t + 2 * h));
          }
          value_[row * kPoints + column + static_cast<std::size_t>(side)] = sum;
        }
      }
    }
  }
  [[nodiscard]] Complex at(double u, double b) const {
    const auto weights = [](double x, std::size_t& first) {
      const double cell = std::floor(x * kPerUnit), h = x * kPerUnit - cell;
      first = static_cast<std::size_t>(cell) + kMargin - 1;
      return std::array<double, 4>{-h * (h - 1) * (h - 2) / 6, (h + 1) * (h - 1) * (h - 2) / 2, -(h + 1) * h * (h - 2) / 2,
                                   (h + 1) * h * (h - 1) / 6};
    };
    std::size_t row, column;
    const auto by_b = weights(b, row), by_u = weights(u, column);
    double real = 0, imaginary = 0;
    for (std::size_t i = 0; i < 4; ++i) {
      const Complex* line = &value_[(row + i) * kPoints + column];
      double line_real = 0, line_imaginary = 0;
      for (std::size_t j = 0; j < 4; ++j) line_real += by_u[j] * line[j].real(), line_imaginary += by_u[j] * line[j].imag();
      real += by_b[i] * line_real;
      imaginary += by_b[i] * line_imaginary;
    }
    return {real, imaginary};
  }

 private:
  std::vector<Complex> value_;
};

/// exp(j u^2) times the integral of exp(-j t^2) from u on.
Complex fresnel_tail(Complex end_erfc) {
  constexpr double half = 0.5 / std::numbers::inv_sqrtpi * std::numbers::sqrt2 / 2;
  return times({half, -half}, end_erfc);
}

}  // namespace

namespace {

/// edge_tail where one of its series does.
Complex edge_tail_far(double u, double b, Complex end_erfc) {
  if (u >= kNear) {
    // By parts, twice: exp(-j u^2) w (1 + w' / (2 j u w)), w = 1 / (2 j u (u^2 + b^2)).
    const double square = u * u + b * b, w = b / (kPi * 2.0 * u * square), next = (1.0 / u + 2.0 * u / square) / (2.0 * u);
    return {w * next, -w};  // -j w (1 + j next)
  }
  // 1 / (t^2 + b^2) = (1 - t g(t)) / b^2, g = t / (t^2 + b^2); the second term by parts, with the slope of g at u.
  const double square = u * u + b * b, slope = (b * b - u * u) / (square * square);
  const Complex tail = times(Complex(1.0, 0.5 * slope), fresnel_tail(end_erfc)) + Complex(0, 0.5 * u / square);
  return tail / (kPi * b);
}

/// Where none does.  pole: exp(j b^2).
Complex edge_tail_near(double u, double b, Complex own_erfc, Complex turn, Complex pole) {
  static const SmoothPart smooth;
  const Complex inside = fast_atan2(u, b) * pole + smooth.at(u, b);
  return times(turn, 0.5 * own_erfc - inside / kPi);
}

}  // namespace

Complex edge_tail(double u, double b, Complex own_erfc, Complex end_erfc, Complex turn) {
  if (u >= kNear || b >= kNear) return edge_tail_far(u, b, end_erfc);
  return edge_tail_near(u, b, own_erfc, turn, fast_unit_phase(b * b));
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
  return sum / kPi;
}

FiniteWedge::FiniteWedge(const DiffractionEdge& edge, glm::dvec3 before, glm::dvec3 after)
    : wedge_(edge.exterior_rad, edge.angle_of(before), edge.angle_of(after)) {
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
  const double nu = kPi / edge.exterior_rad;
  for (std::size_t i = 0; i < 2; ++i) {
    const double z = i == 0 ? 0.0 : edge.length_m;
    const double m = length_of(source_r, z - source_z), l = length_of(listener_r, z - listener_z);
    ends_[i].detour_m = std::max(m + l - shortest_m, 0.0);
    const double slope = m > 0 && l > 0 ? std::abs((z - source_z) / m + (z - listener_z) / l) : 0.0;
    if (!(ends_[i].detour_m > 1e-9 * shortest_m) || !(slope > 1e-9) || !(source_r * listener_r > 1e-9 * shortest_m * shortest_m)) continue;
    const double cosh_eta = (m * l + (z - source_z) * (z - listener_z)) / (source_r * listener_r);
    const double cosh_nu_eta = std::cosh(nu * std::acosh(std::max(cosh_eta, 1.0)));
    const double spreading = nu * shortest_m / (4.0 * kPi) / (m * l) * 2.0 * std::sqrt(ends_[i].detour_m) / slope;
    for (std::size_t term = 0; term < 4; ++term) {
      const double theory = wedge_.weight(term) * std::sqrt(2.0 * own_length_m_) * wedge_.boundary(term) /
                            (kPi * (ends_[i].detour_m + 2.0 * own_length_m_ * wedge_.boundary(term) * wedge_.boundary(term)));
      const double d = nu * wedge_.from_boundary(term), below = cosh_nu_eta - std::cos(d);
      ends_[i].residue[term] = below > 1e-12 ? -spreading * std::sin(d) / below - theory : 0.0;
    }
  }
}

Complex FiniteWedge::ratio(double wavenumber, double length_m, const FaceFactors& faces) const {
  struct Tail {
    double u;
    Complex erfc, turn, fresnel;
  };
  std::array<Tail, 2> tails;
  const double root = std::sqrt(wavenumber);
  for (std::size_t i = 0; i < 2; ++i) {
    const double phase = wavenumber * ends_[i].detour_m, u = std::sqrt(phase);
    const Complex erfc = scaled_erfc(u);
    tails[i] = {u, erfc, fast_unit_phase(phase), fresnel_tail(erfc) / root};
  }
  // What the ends leave out of the endless edge; past an end, what is left between them.  Sums at each end, over all terms.
  const std::array<double, 4> face = {faces.incidence, faces.incidence, faces.first, faces.second};
  const double scale = std::sqrt(2.0 * wavenumber * length_m);
  Complex whole = 0;
  std::array<Complex, 2> end{};
  for (std::size_t term = 0; term < 4; ++term) {
    if (face[term] == 0) continue;
    const double weight = wedge_.weight(term) * face[term], b = scale * wedge_.boundary(term);
    const Complex erfc = scaled_erfc(b);
    whole += weight * erfc;
    const bool near = b < kNear && (tails[0].u < kNear || tails[1].u < kNear);
    const Complex pole = near ? fast_unit_phase(b * b) : Complex();  // once for both ends
    for (std::size_t i = 0; i < 2; ++i) {
      const Tail& tail = tails[i];
      const Complex beyond =
          near && tail.u < kNear ? edge_tail_near(tail.u, b, erfc, tail.turn, pole) : edge_tail_far(tail.u, b, tail.erfc);
      end[i] += weight * beyond + face[term] * ends_[i].residue[term] * tail.fresnel;
    }
  }
  Complex sum;
  if (past_end_ < 0) {
    sum = whole - times(end[0], std::conj(tails[0].turn)) - times(end[1], std::conj(tails[1].turn));
  } else {
    const auto near = static_cast<std::size_t>(past_end_), far = 1 - near;
    sum = end[near] - times(end[far], times(std::conj(tails[far].turn), tails[near].turn));
  }
  // As the endless edge, at most twice the free field.
  const double norm = std::norm(sum);
  return norm > 4.0 ? sum * (2.0 / std::sqrt(norm)) : sum;
}

}  // namespace earshot
