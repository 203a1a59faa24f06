// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <complex>
#include <cstddef>
#include <glm/geometric.hpp>
#include <glm/vec2.hpp>
#include <numbers>
#include <span>
#include <utility>
#include <vector>

/// Sound scattered by thin rigid sheets in two dimensions, by boundary elements: the jump of the pressure across each sheet is constant on
/// each element, and the normal velocity vanishes in its middle.  The hypersingular integral is that of Maue 1949 (Z. Phys. 126, 601-618):
/// derivatives of the free field's function at the ends of an element, and k^2 of its integral.  Elements are those of Chebyshev's nodes,
/// fine at the rims, so that the error falls as the square of their size.  Shares no code with the engine.  exp(+j w t).
namespace earshot::rigid_sheets {

using Complex = std::complex<double>;
using Point = glm::dvec2;
/// A sheet: its corners in order.
using Sheet = std::vector<Point>;

/// Hankel functions of the second kind.
inline Complex hankel0(double x) { return {::j0(x), -::y0(x)}; }
inline Complex hankel1(double x) { return {::j1(x), -::y1(x)}; }
/// The free field of a line source.
inline Complex free_field(double wavenumber, double distance_m) { return Complex(0, -0.25) * hankel0(wavenumber * distance_m); }
/// Its derivative by distance.
inline Complex free_slope(double wavenumber, double distance_m) { return Complex(0, 0.25 * wavenumber) * hankel1(wavenumber * distance_m); }

struct Element {
  Point start, end, at;  ///< at: where the velocity vanishes
  Point along, normal;
  double length_m;
};

/// `per_wave`: elements per wave where they are largest.
inline std::vector<Element> elements_of(std::span<const Sheet> sheets, double wavenumber, double per_wave = 9) {
  const double pi = std::numbers::pi;
  std::vector<Element> elements;
  for (const Sheet& sheet : sheets)
    for (std::size_t corner = 0; corner + 1 < sheet.size(); ++corner) {
      const Point from = sheet[corner], to = sheet[corner + 1];
      const double length_m = glm::length(to - from);
      const int count = std::max(8, static_cast<int>(std::ceil(length_m * wavenumber / (2 * pi) * per_wave * pi / 2)));
      const auto node = [&](double i) { return from + (0.5 - 0.5 * std::cos(pi * i / count)) * (to - from); };
      for (int i = 0; i < count; ++i) {
        Element e{node(i), node(i + 1), node(i + 0.5), (to - from) / length_m, {}, 0};
        e.normal = {-e.along.y, e.along.x};
        e.length_m = glm::length(e.end - e.start);
        elements.push_back(e);
      }
    }
  return elements;
}

/// Four points of Gauss on an element.
template <class F>
void for_points_of(const Element& e, const F& visit) {
  constexpr double at[4] = {-0.8611363115940526, -0.3399810435848563, 0.3399810435848563, 0.8611363115940526};
  constexpr double weight[4] = {0.3478548451374538, 0.6521451548625461, 0.6521451548625461, 0.3478548451374538};
  for (int i = 0; i < 4; ++i) visit(0.5 * (e.start + e.end) + 0.5 * at[i] * (e.end - e.start), 0.5 * weight[i] * e.length_m);
}

/// Solves a x = b for several b, in place, by Gauss with the largest pivot of a column.
inline void solve(std::vector<Complex>& a, std::vector<std::vector<Complex>>& b) {
  const std::size_t n = b.front().size();
  for (std::size_t i = 0; i < n; ++i) {
    std::size_t pivot = i;
    for (std::size_t row = i + 1; row < n; ++row)
      if (std::norm(a[row * n + i]) > std::norm(a[pivot * n + i])) pivot = row;
    if (pivot != i) {
      for (std::size_t column = i; column < n; ++column) std::swap(a[i * n + column], a[pivot * n + column]);
      for (auto& right : b) std::swap(right[i], right[pivot]);
    }
    const Complex inverse = 1.0 / a[i * n + i];
    for (std::size_t row = i + 1; row < n; ++row) {
      const Complex factor = a[row * n + i] * inverse;
      const double re = factor.real(), im = factor.imag();
      Complex* __restrict target = &a[row * n];
      const Complex* __restrict from = &a[i * n];
      for (std::size_t column = i + 1; column < n; ++column) {
        const double x = from[column].real(), y = from[column].imag();
        target[column] -= Complex(re * x - im * y, re * y + im * x);
      }
      for (auto& right : b) right[row] -= factor * right[i];
    }
  }
  for (auto& right : b)
    for (std::size_t i = n; i-- > 0;) {
      for (std::size_t column = i + 1; column < n; ++column) right[i] -= a[i * n + column] * right[column];
      right[i] /= a[i * n + i];
    }
}

/// The field of line sources scattered by sheets, at one frequency.
class ScatteredField {
 public:
  ScatteredField(std::span<const Sheet> sheets, std::span<const Point> sources, double wavenumber, double per_wave = 9)
      : k_(wavenumber), elements_(elements_of(sheets, wavenumber, per_wave)) {
    const std::size_t n = elements_.size();
    std::vector<Complex> matrix(n * n);
    for (std::size_t i = 0; i < n; ++i)
      for (std::size_t j = 0; j < n; ++j) matrix[i * n + j] = velocity(elements_[i], elements_[j], i == j);
    for (const Point source : sources) {
      std::vector<Complex>& right = jump_.emplace_back(n);
      for (std::size_t i = 0; i < n; ++i) {
        const Point from = elements_[i].at - source;
        const double r = glm::length(from);
        right[i] = -free_slope(k_, r) * (glm::dot(elements_[i].normal, from) / r);
      }
    }
    solve(matrix, jump_);
  }

  [[nodiscard]] Complex at(Point listener, std::size_t source = 0) const {
    Complex sum = 0;
    for (std::size_t j = 0; j < elements_.size(); ++j)
      for_points_of(elements_[j], [&](Point y, double weight) {
        const Point from = listener - y;
        const double r = glm::length(from);
        sum -= weight * jump_[source][j] * free_slope(k_, r) * (glm::dot(elements_[j].normal, from) / r);
      });
    return sum;
  }
  [[nodiscard]] std::size_t size() const { return elements_.size(); }

 private:
  /// Normal velocity in the middle of an element due to a jump of 1 on another one.
  [[nodiscard]] Complex velocity(const Element& here, const Element& there, bool same) const {
    Complex integral = 0;
    if (same) {
      for (const Point end : {here.start, here.end}) {
        const double h = glm::length(end - here.at);
        integral += Complex(0, -0.25) * h * Complex(1, -2 / std::numbers::pi * (std::log(k_ * h / 2) + std::numbers::egamma - 1));
      }
    } else {
      for_points_of(there, [&](Point y, double weight) { integral += weight * free_field(k_, glm::length(here.at - y)); });
    }
    const auto slope_along = [&](Point end) {
      const Point from = here.at - end;
      const double r = glm::length(from);
      return free_slope(k_, r) * (glm::dot(here.along, from) / r);
    };
    return k_ * k_ * glm::dot(here.along, there.along) * integral + slope_along(there.start) - slope_along(there.end);
  }

  double k_;
  std::vector<Element> elements_;
  std::vector<std::vector<Complex>> jump_;  ///< by source
};

}  // namespace earshot::rigid_sheets
