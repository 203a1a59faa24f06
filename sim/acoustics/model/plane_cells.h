// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <compare>
#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <memory>
#include <vector>

namespace earshot {

class AcousticScene;

/// Planes that a specular ray meets one after the other, from the source.
struct PlaneSequence {
  static constexpr int kMaxOrder = 4;
  std::array<std::uint32_t, kMaxOrder> plane{};
  int order = 0;
  auto operator<=>(const PlaneSequence&) const = default;
};

/// Appends what a specular ray meets: a sequence for each of its reflections up to image_order().
void append_sequences(const AcousticScene& scene, glm::vec3 origin, glm::vec3 direction, std::vector<PlaneSequence>& sequences);

/// Plane sequences by cells of the air, for sources that move: what rays from all over a cell meet, found when a source comes into it first
/// and kept for its next poses and for other sources.  The sequences of a cell are a function of (scene, seed, cell), independent of the
/// order of requests: rays
/// start at points spread over the cell, in directions spread over the sphere.  Any thread; bounded to kMaxCells cells of about 10 KiB, of
/// which the oldest goes.
class PlaneCells {
 public:
  static constexpr float kCellM = 1.f;  ///< a sixteenth of the scene's diagonal if that is less
  static constexpr std::size_t kMaxCells = 512;

  PlaneCells();
  ~PlaneCells();
  /// Sorted, each once.  config.early_candidate_rays rays for a cell that is not known: about 2 ms in a house; else 0.1 us.
  [[nodiscard]] std::shared_ptr<const std::vector<PlaneSequence>> of(const AcousticScene& scene, glm::vec3 point) const;
  [[nodiscard]] std::size_t size() const;
  [[nodiscard]] std::size_t bytes() const;  ///< of memory, held now

 private:
  struct Cells;
  std::unique_ptr<Cells> cells_;
};

}  // namespace earshot
