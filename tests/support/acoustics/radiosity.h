// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <numbers>
#include <span>
#include <vector>

/// Radiosity of an empty box with Lambert walls: an independent solution of what the path tracer estimates.  Patches are equal rectangles;
/// form factors and solid angles are analytic (Howell, Catalog of Radiation Configuration Factors, C-13 and C-16); sound travels from
/// centre to centre.  The error of a patch size h falls as h^2: take two sizes and extrapolate.
namespace earshot::radiosity {

using Point = std::array<double, 3>;

struct Box {
  Point size_m;
  std::array<double, 6> absorption;  ///< x0, x1, y0, y1, z0, z1
  double speed_of_sound_m_per_s = 343.0;
};

/// A rectangle in the plane where axis `normal` is `plane_m`.
struct Patch {
  int normal;
  double plane_m;
  Point low, high;  ///< along `normal` both are plane_m
  double reflectance;
  [[nodiscard]] Point centre() const { return {0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), 0.5 * (low[2] + high[2])}; }
  [[nodiscard]] double area_m2() const {
    const int u = (normal + 1) % 3, v = (normal + 2) % 3;
    return (high[u] - low[u]) * (high[v] - low[v]);
  }
};

inline double distance_m(const Point& a, const Point& b) { return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]); }

inline std::vector<Patch> make_patches(const Box& box, double patches_per_m) {
  std::vector<Patch> patches;
  for (int wall = 0; wall < 6; ++wall) {
    const int normal = wall / 2, u = (normal + 1) % 3, v = (normal + 2) % 3;
    const int count_u = std::max(1, static_cast<int>(std::lround(box.size_m[u] * patches_per_m)));
    const int count_v = std::max(1, static_cast<int>(std::lround(box.size_m[v] * patches_per_m)));
    for (int i = 0; i < count_u; ++i) {
      for (int j = 0; j < count_v; ++j) {
        Patch patch{normal, wall % 2 == 0 ? 0.0 : box.size_m[normal], {}, {}, 1 - box.absorption[wall]};
        patch.low[normal] = patch.high[normal] = patch.plane_m;
        patch.low[u] = box.size_m[u] * i / count_u, patch.high[u] = box.size_m[u] * (i + 1) / count_u;
        patch.low[v] = box.size_m[v] * j / count_v, patch.high[v] = box.size_m[v] * (j + 1) / count_v;
        patches.push_back(patch);
      }
    }
  }
  return patches;
}

/// Antiderivatives of the double area integrals, for parallel and perpendicular rectangles.
inline double parallel_term(double dx, double dy, double gap) {
  const double a = std::hypot(dx, gap), b = std::hypot(dy, gap);
  return (dy * a * std::atan(dy / a) + dx * b * std::atan(dx / b) - 0.5 * gap * gap * std::log(dx * dx + dy * dy + gap * gap)) /
         (2 * std::numbers::pi);
}
inline double perpendicular_term(double x, double xi, double dy) {
  const double c2 = x * x + xi * xi, r2 = c2 + dy * dy;
  if (r2 < 1e-24) return 0;
  const double c = std::sqrt(c2);
  const double angle = c > 0 ? dy * c * std::atan(dy / c) : 0;
  return (angle - 0.25 * (c2 - dy * dy) * std::log(r2)) / (2 * std::numbers::pi);
}

/// Form factor: the fraction of the energy that leaves a and arrives at b.
inline double form_factor(const Patch& a, const Patch& b) {
  double sum = 0;
  const auto sign = [](int bits) { return (bits & 1) != 0 ? -1.0 : 1.0; };
  if (a.normal == b.normal) {
    if (a.plane_m == b.plane_m) return 0;
    const int u = (a.normal + 1) % 3, v = (a.normal + 2) % 3;
    for (int i = 0; i < 2; ++i)
      for (int j = 0; j < 2; ++j)
        for (int k = 0; k < 2; ++k)
          for (int l = 0; l < 2; ++l) {
            const double du = (i != 0 ? a.high[u] : a.low[u]) - (k != 0 ? b.high[u] : b.low[u]);
            const double dv = (j != 0 ? a.high[v] : a.low[v]) - (l != 0 ? b.high[v] : b.low[v]);
            sum += sign(i + j + k + l) * parallel_term(du, dv, a.plane_m - b.plane_m);
          }
    return sum / a.area_m2();
  }
  // x: on a, away from the plane of b; xi: on b, away from the plane of a; y: along the common edge.
  const int y = 3 - a.normal - b.normal;
  for (int i = 0; i < 2; ++i)
    for (int j = 0; j < 2; ++j)
      for (int k = 0; k < 2; ++k)
        for (int l = 0; l < 2; ++l) {
          double x[2] = {std::fabs(a.low[b.normal] - b.plane_m), std::fabs(a.high[b.normal] - b.plane_m)};
          double xi[2] = {std::fabs(b.low[a.normal] - a.plane_m), std::fabs(b.high[a.normal] - a.plane_m)};
          if (x[0] > x[1]) std::swap(x[0], x[1]);
          if (xi[0] > xi[1]) std::swap(xi[0], xi[1]);
          const double dy = (j != 0 ? a.high[y] : a.low[y]) - (k != 0 ? b.high[y] : b.low[y]);
          sum += sign(i + j + k + l) * perpendicular_term(x[i], xi[l], dy);
        }
  return sum / a.area_m2();
}

/// Of a rectangle from a point.
inline double solid_angle(const Patch& patch, const Point& from) {
  const int u = (patch.normal + 1) % 3, v = (patch.normal + 2) % 3;
  const double gap = std::fabs(patch.plane_m - from[patch.normal]);
  const auto corner = [&](double du, double dv) { return std::atan(du * dv / (gap * std::sqrt(du * du + dv * dv + gap * gap))); };
  const double u0 = patch.low[u] - from[u], u1 = patch.high[u] - from[u], v0 = patch.low[v] - from[v], v1 = patch.high[v] - from[v];
  return corner(u1, v1) - corner(u0, v1) - corner(u1, v0) + corner(u0, v0);
}

/// Transport between the patches of one size.
class Solver {
 public:
  Solver(const Box& box, double patches_per_m) : box_(box), patches_(make_patches(box, patches_per_m)) {
    const std::size_t n = patches_.size();
    factor_.resize(n * n);
    delay_s_.resize(n * n);
    for (std::size_t i = 0; i < n; ++i)
      for (std::size_t j = 0; j < n; ++j) {
        factor_[i * n + j] = form_factor(patches_[i], patches_[j]);
        delay_s_[i * n + j] = distance_m(patches_[i].centre(), patches_[j].centre()) / box.speed_of_sound_m_per_s;
      }
  }
  [[nodiscard]] std::size_t size() const { return patches_.size(); }
  /// Largest departure of a row of form factors from 1: every direction meets some patch.
  [[nodiscard]] double row_error() const {
    double worst = 0;
    for (std::size_t i = 0; i < size(); ++i) {
      double sum = 0;
      for (std::size_t j = 0; j < size(); ++j) sum += factor_[i * size() + j];
      worst = std::max(worst, std::fabs(sum - 1));
    }
    return worst;
  }
  /// All energy that reaches the listener after at least one reflection, Green units (the fluence of a unit source over 4 pi).
  [[nodiscard]] double steady_energy(const Point& source, const Point& listener) const {
    const std::vector<double> direct = irradiance(source);
    std::vector<double> radiosity(size(), 0.0), next(size());
    for (int pass = 0; pass < 2000; ++pass) {
      double change = 0, total = 0;
      for (std::size_t i = 0; i < size(); ++i) {
        double arriving = direct[i];
        for (std::size_t j = 0; j < size(); ++j) arriving += factor_[i * size() + j] * radiosity[j];
        next[i] = patches_[i].reflectance * arriving;
        change += std::fabs(next[i] - radiosity[i]), total += next[i];
      }
      radiosity.swap(next);
      if (change < 1e-13 * total) break;
    }
    double energy = 0;
    for (std::size_t i = 0; i < size(); ++i) energy += radiosity[i] * seen(patches_[i], listener);
    return energy;
  }
  /// Reverberation time of the slowest mode: at its decay rate k, transport weighted with exp(k delay) just keeps the energy.
  [[nodiscard]] double slowest_decay_s() const {
    double low = 0, high = 1;
    while (growth(high) < 1) low = high, high *= 2;
    for (int pass = 0; pass < 40 && high - low > 1e-9 * high; ++pass) {
      const double middle = 0.5 * (low + high);
      (growth(middle) < 1 ? low : high) = middle;
    }
    return 6 * std::numbers::ln10 / (0.5 * (low + high));
  }
  /// Energy at the listener per time bin, reflections only; an arrival between the centres of two bins is shared between them.
  [[nodiscard]] std::vector<double> energy_series(const Point& source, const Point& listener, double bin_s, double length_s) const {
    const auto bins = static_cast<std::size_t>(length_s / bin_s);
    const std::vector<double> direct = irradiance(source);
    // irradiance [patch][bin], filled forward in time: every delay is at least a part of a bin, so what is read is complete once its own
    // bin is reached; delays are kept at least one bin long.
    std::vector<double> arriving(size() * (bins + 1), 0.0), series(bins + 1, 0.0);
    const auto add = [&](std::span<double> row, double at_bin, double energy) {
      const auto i = static_cast<std::size_t>(at_bin);
      if (i + 1 >= row.size()) return;
      row[i] += energy * (1 - (at_bin - static_cast<double>(i)));
      row[i + 1] += energy * (at_bin - static_cast<double>(i));
    };
    const auto row = [&](std::size_t patch) { return std::span(arriving).subspan(patch * (bins + 1), bins + 1); };
    for (std::size_t i = 0; i < size(); ++i) {
      add(row(i), distance_m(source, patches_[i].centre()) / box_.speed_of_sound_m_per_s / bin_s, direct[i]);
    }
    std::vector<std::size_t> whole(size() * size());
    std::vector<double> part(size() * size());
    for (std::size_t k = 0; k < whole.size(); ++k) {
      const double bins_late = std::max(1.0, delay_s_[k] / bin_s);
      whole[k] = static_cast<std::size_t>(bins_late);
      part[k] = bins_late - static_cast<double>(whole[k]);
    }
    // Gather: what patch i gets in bin t left j in bins t - delay.  Bin by bin, so that all sources are complete.
    for (std::size_t t = 1; t <= bins; ++t) {
      for (std::size_t i = 0; i < size(); ++i) {
        double sum = 0;
        const std::size_t first = i * size();
        for (std::size_t j = 0; j < size(); ++j) {
          const double factor = factor_[first + j];
          if (factor == 0) continue;
          const std::size_t late = whole[first + j];
          if (t < late) continue;
          const double* from = &arriving[j * (bins + 1)];
          const double newer = from[t - late], older = t > late ? from[t - late - 1] : 0.0;
          sum += factor * patches_[j].reflectance * (newer + part[first + j] * (older - newer));
        }
        arriving[i * (bins + 1) + t] += sum;
      }
    }
    for (std::size_t i = 0; i < size(); ++i) {
      const double late = distance_m(listener, patches_[i].centre()) / box_.speed_of_sound_m_per_s / bin_s;
      const double gain = patches_[i].reflectance * seen(patches_[i], listener);
      for (std::size_t t = 0; t <= bins; ++t) {
        if (row(i)[t] > 0) add(series, static_cast<double>(t) + late, gain * row(i)[t]);
      }
    }
    return series;
  }

 private:
  [[nodiscard]] std::vector<double> irradiance(const Point& source) const {
    std::vector<double> result;
    for (const Patch& patch : patches_) result.push_back(solid_angle(patch, source) / (4 * std::numbers::pi * patch.area_m2()));
    return result;
  }
  /// Energy at a point for unit radiosity: radiance 1 / pi over the solid angle is the fluence.
  [[nodiscard]] static double seen(const Patch& patch, const Point& listener) {
    return solid_angle(patch, listener) / (4 * std::numbers::pi * std::numbers::pi);
  }
  /// Largest eigenvalue of transport with delays weighted by exp(rate delay), by power iteration.
  [[nodiscard]] double growth(double rate) const {
    std::vector<double> weight(factor_.size());
    for (std::size_t k = 0; k < weight.size(); ++k) {
      weight[k] = factor_[k] * patches_[k % size()].reflectance * std::exp(rate * delay_s_[k]);
    }
    std::vector<double> mode(size(), 1.0), next(size());
    double value = 0;
    for (int pass = 0; pass < 400; ++pass) {
      double sum = 0, before = 0;
      for (std::size_t i = 0; i < size(); ++i) {
        next[i] = 0;
        for (std::size_t j = 0; j < size(); ++j) next[i] += weight[i * size() + j] * mode[j];
        sum += next[i], before += mode[i];
      }
      const double last = value;
      value = sum / before;
      for (std::size_t i = 0; i < size(); ++i) mode[i] = next[i] / value;
      if (std::fabs(value - last) < 1e-12 * value) break;
    }
    return value;
  }

  Box box_;
  std::vector<Patch> patches_;
  std::vector<double> factor_, delay_s_;  ///< [to][from]
};

/// Value at patch size zero from values at two patch sizes whose errors go as the square.
inline double extrapolate(double coarse, double coarse_per_m, double fine, double fine_per_m) {
  const double ratio = (fine_per_m / coarse_per_m) * (fine_per_m / coarse_per_m);
  return (ratio * fine - coarse) / (ratio - 1);
}

}  // namespace earshot::radiosity
