// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/specular_lobe.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <utility>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr float kPi = std::numbers::pi_v<float>;
constexpr int kAlbedoCells = 2048;
constexpr int kCompensationCells = 256;
constexpr int kPanels = 4, kPoints = 32;  // of the quadrature over the lobe

/// Nodes and weights on [-1, 1] by Newton's method on the Legendre polynomial.
struct GaussLegendre {
  std::array<double, kPoints> node, weight;
  GaussLegendre() {
    for (int i = 0; i < kPoints; ++i) {
      double x = std::cos(std::numbers::pi * (i + 0.75) / (kPoints + 0.5)), slope = 1;
      for (int step = 0; step < 20; ++step) {
        double before = 1, here = x;
        for (int k = 2; k <= kPoints; ++k) before = std::exchange(here, ((2 * k - 1) * x * here - (k - 1) * before) / k);
        slope = kPoints * (x * here - before) / (x * x - 1);
        x -= here / slope;
      }
      node[i] = x;
      weight[i] = 2 / ((1 - x * x) * slope * slope);
    }
  }
};

/// Mean over the azimuth of min(1, z / c) where z = a + b cos(azimuth) > 0 is the cosine of the outgoing direction.
double mean_over_azimuth(double a, double b, double c) {
  const double above = b > 0 ? std::acos(std::clamp(-a / b, -1.0, 1.0)) : (a > 0 ? std::numbers::pi : 0.0);
  const double whole = b > 0 ? std::acos(std::clamp((c - a) / b, -1.0, 1.0)) : (a >= c ? std::numbers::pi : 0.0);
  const double partial = c > 0 ? (a * (above - whole) + b * (std::sin(above) - std::sin(whole))) / c : 0.0;
  return (whole + partial) / std::numbers::pi;
}

/// Albedo of the Phong lobe: with t = cos gamma and w = t^(n + 1) it is (n + 2) / (n + 1) times the integral over w of the azimuth's mean.
double integrate_albedo(double n, double cosine, const GaussLegendre& rule) {
  const double sine = std::sqrt(std::max(0.0, 1 - cosine * cosine));
  double sum = 0;
  for (int panel = 0; panel < kPanels; ++panel) {
    for (int i = 0; i < kPoints; ++i) {
      const double w = (panel + 0.5 * (rule.node[i] + 1)) / kPanels;
      const double t = std::pow(w, 1 / (n + 1));
      sum += rule.weight[i] * mean_over_azimuth(t * cosine, std::sqrt(std::max(0.0, 1 - t * t)) * sine, cosine);
    }
  }
  return (n + 2) / (n + 1) * sum / (2 * kPanels);
}

/// Vector at the given cosine and azimuth about a unit axis (frame of Duff et al., JCGT 2017).
glm::vec3 about(glm::vec3 axis, float cosine, float azimuth) {
  const float sign = std::copysign(1.f, axis.z);
  const float a = -1.f / (sign + axis.z), b = axis.x * axis.y * a;
  const glm::vec3 x(1.f + sign * axis.x * axis.x * a, sign * b, -sign * axis.x), y(b, sign + axis.y * axis.y * a, -axis.y);
  const float sine = std::sqrt(std::max(0.f, 1.f - cosine * cosine));
  const glm::vec3 result = sine * std::cos(azimuth) * x + sine * std::sin(azimuth) * y + cosine * axis;
  return result / std::sqrt(glm::dot(result, result));
}

}  // namespace

SpecularLobe::SpecularLobe(float exponent) : exponent_(exponent) {
  EARSHOT_EXPECT(exponent >= 1.f);
  const GaussLegendre rule;
  albedo_.resize(kAlbedoCells + 1);
  for (int i = 0; i <= kAlbedoCells; ++i) {
    albedo_[i] = static_cast<float>(integrate_albedo(exponent, static_cast<double>(i) / kAlbedoCells, rule));
  }
  // The mean is that of the table, not of the true curve: then the compensation gives back exactly what the table says is lost.
  double mean = 0;
  for (int i = 0; i < kAlbedoCells; ++i) {
    const double left = static_cast<double>(i) / kAlbedoCells, width = 1.0 / kAlbedoCells;
    const double low = albedo_[i], high = albedo_[i + 1];  // Simpson, exact for a line times the cosine
    mean += 2 * width / 6 * (low * left + 2 * (low + high) * (left + 0.5 * width) + high * (left + width));
  }
  mean_albedo_ = static_cast<float>(mean);

  cell_density_.resize(kCompensationCells);
  cell_end_.resize(kCompensationCells);
  double total = 0;
  std::array<double, kCompensationCells> mass;
  for (int i = 0; i < kCompensationCells; ++i) {
    mass[i] = 0;
    for (int k = 0; k < 16; ++k) {
      mass[i] += 1.0 - phong_albedo(std::sqrt((static_cast<float>(i) + (static_cast<float>(k) + 0.5f) / 16.f) / kCompensationCells));
    }
    mass[i] = std::max(mass[i], 1e-6);  // every cell can be reached
    total += mass[i];
  }
  double running = 0;
  for (int i = 0; i < kCompensationCells; ++i) {
    cell_density_[i] = static_cast<float>(mass[i] / total * kCompensationCells);
    running += mass[i];
    cell_end_[i] = static_cast<float>(running / total);
  }
  cell_end_.back() = 1.f;
}

float SpecularLobe::phong_albedo(float cosine) const {
  const float position = std::clamp(cosine, 0.f, 1.f) * kAlbedoCells;
  const int cell = std::min(static_cast<int>(position), kAlbedoCells - 1);
  return albedo_[cell] + (position - static_cast<float>(cell)) * (albedo_[cell + 1] - albedo_[cell]);
}

float SpecularLobe::compensation_density(float cosine) const {
  const int cell = std::min(static_cast<int>(cosine * cosine * kCompensationCells), kCompensationCells - 1);
  return cell_density_[cell];
}

float SpecularLobe::value(glm::vec3 normal, glm::vec3 in, glm::vec3 out) const {
  const float cos_in = glm::dot(normal, in), cos_out = glm::dot(normal, out);
  if (!(cos_in > 0.f && cos_out > 0.f)) return 0.f;
  const float cos_gamma = 2.f * cos_in * cos_out - glm::dot(in, out);
  float phong = 0.f;
  if (cos_gamma > 0.f) {
    phong = (exponent_ + 2.f) / (2.f * kPi) * std::pow(std::min(cos_gamma, 1.f), exponent_) / std::max(cos_in, cos_out);
  }
  // For n near 1 the albedo exceeds 1 by up to 3e-4 around 10 degrees; the compensation takes that away too.
  return std::max(phong + (1.f - phong_albedo(cos_in)) * (1.f - phong_albedo(cos_out)) / (kPi * (1.f - mean_albedo_)), 0.f);
}

float SpecularLobe::pdf(glm::vec3 normal, glm::vec3 in, glm::vec3 out) const {
  const float cos_in = glm::dot(normal, in), cos_out = glm::dot(normal, out);
  if (!(cos_in > 0.f && cos_out > 0.f)) return 0.f;
  // Both what left upward and what left downward and was folded up: the cosine to the mirror direction of the latter is -in.out.
  const float between = glm::dot(in, out), cos_gamma = 2.f * cos_in * cos_out - between;
  float powers = 0.f;
  if (cos_gamma > 0.f) powers += std::pow(std::min(cos_gamma, 1.f), exponent_);
  if (between < 0.f) powers += std::pow(std::min(-between, 1.f), exponent_);
  const float fraction = std::min(phong_albedo(cos_in), 1.f);
  return fraction * (exponent_ + 1.f) / (2.f * kPi) * powers + (1.f - fraction) * cos_out / kPi * compensation_density(cos_out);
}

glm::vec3 SpecularLobe::sample(glm::vec3 normal, glm::vec3 in, float u, float v, float w) const {
  const float azimuth = 2.f * kPi * v, cos_in = glm::dot(normal, in);
  if (w < phong_albedo(cos_in)) {
    const glm::vec3 mirror = 2.f * cos_in * normal - in;
    const glm::vec3 out = about(mirror / std::sqrt(glm::dot(mirror, mirror)), std::pow(u, 1.f / (exponent_ + 1.f)), azimuth);
    const float height = glm::dot(normal, out);
    return height < 0.f ? out - 2.f * height * normal : out;
  }
  const auto cell = static_cast<std::size_t>(
      std::min<std::ptrdiff_t>(std::upper_bound(cell_end_.begin(), cell_end_.end(), u) - cell_end_.begin(), kCompensationCells - 1));
  const float before = cell == 0 ? 0.f : cell_end_[cell - 1];
  const float within = std::clamp((u - before) / std::max(cell_end_[cell] - before, 1e-12f), 0.f, 1.f);
  return about(normal, std::sqrt((static_cast<float>(cell) + within) / kCompensationCells), azimuth);
}

}  // namespace earshot
