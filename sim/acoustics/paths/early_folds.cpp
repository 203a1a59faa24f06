// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>

#include "sim/acoustics/geometry/exact_plane.h"
#include "sim/acoustics/paths/early_reflections.h"
#include "sim/acoustics/paths/panel_reflection.h"

namespace earshot {

void EarlyCandidates::add_folds(const AcousticScene& scene) {
  const auto num_planes = static_cast<std::uint32_t>(scene.planes().size());
  const FoldedPlanes& folds = scene.folds();
  const auto no_fold = static_cast<std::uint32_t>(folds.planes.size());
  // Triangles of one plane may lie in several folds.
  std::vector<std::vector<std::uint32_t>> of_plane(num_planes);
  for (std::size_t triangle = 0; triangle < folds.fold_of_triangle.size(); ++triangle) {
    const std::uint32_t fold = folds.fold_of_triangle[triangle];
    auto& known = of_plane[scene.plane_of_triangle()[triangle]];
    if (fold != no_fold && std::find(known.begin(), known.end(), fold) == known.end()) known.push_back(fold);
  }
  std::vector<Sequence> by_folds;
  for (std::size_t i = 0; i < num_by_planes_; ++i) {
    std::vector<Sequence> choices = {{}};
    for (int n = 0; n < sequences_[i].order; ++n) {
      const std::uint32_t plane = sequences_[i].plane[n];
      std::vector<Sequence> longer;
      for (const Sequence& prefix : choices) {
        const auto append = [&](std::uint32_t next) {
          longer.push_back(prefix);
          longer.back().plane[n] = next;
          ++longer.back().order;
        };
        for (const std::uint32_t fold : of_plane[plane]) {
          if (n == 0 || prefix.plane[n - 1] != num_planes + fold) append(num_planes + fold);
        }
        append(plane);
      }
      choices = std::move(longer);
    }
    for (const Sequence& choice : choices) {
      if (std::any_of(choice.plane.begin(), choice.plane.begin() + choice.order, [&](std::uint32_t plane) { return plane >= num_planes; }))
        by_folds.push_back(choice);
    }
  }
  std::sort(by_folds.begin(), by_folds.end());
  by_folds.erase(std::unique(by_folds.begin(), by_folds.end()), by_folds.end());
  sequences_.insert(sequences_.end(), by_folds.begin(), by_folds.end());
}

bool EarlyCandidates::weigh_folds(const AcousticScene& scene, std::span<const std::uint32_t> met, std::span<const std::uint32_t> fold,
                                  bool by_folds, glm::vec3 listener, std::span<double> energy_fraction) const {
  const auto num_planes = static_cast<std::uint32_t>(scene.planes().size());
  const FoldedPlanes& folds = scene.folds();
  // The path by folds that stands for this one: twice in a row in the planes of one fold is once in it.
  std::array<std::uint32_t, kMaxOrder> instead{};
  std::size_t count = 0;
  double deepest_m = 0;
  bool outside = true;
  for (std::size_t i = 0; i < met.size(); ++i) {
    const bool folded = fold[i] < folds.planes.size();
    const std::uint32_t next = folded ? num_planes + fold[i] : met[i];
    if (folded) {
      const ExactPlane plane(folds.planes[fold[i]]);
      const double depth_m = double{folds.depth_m[fold[i]]};
      deepest_m = std::max(deepest_m, depth_m);
      outside = outside && std::abs(plane.height(glm::dvec3(listener))) > depth_m && std::abs(plane.height(glm::dvec3(source()))) > depth_m;
    }
    if (count == 0 || instead[count - 1] != next) instead[count++] = next;
  }
  if (deepest_m == 0) return !by_folds;
  // Between the top and the bottom of a fold there are only its planes; the tracers handle paths over other planes.
  if (by_folds ? !outside || !contains(met)
               : !outside || !find_sequence(std::span(instead).first(count), num_by_planes_, sequences_.size()))
    return !by_folds;
  bool is_audible = false;
  for (int band = 0; band < scene.num_bands(); ++band) {
    const double longer_m = 2.0 * deepest_m, waves = longer_m * scene.bands().centre_hz[band] / scene.speed_of_sound_m_per_s();
    const double one_mirror = boundary_weight(2.0 * waves);  // 1 up to an eighth of a wave, 0 from a quarter on
    energy_fraction[band] *= by_folds ? one_mirror : 1.0 - one_mirror;
    is_audible = is_audible || energy_fraction[band] > 0;
  }
  return is_audible;
}

}  // namespace earshot
