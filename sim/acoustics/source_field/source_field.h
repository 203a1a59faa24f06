// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <glm/vec3.hpp>
#include <memory>
#include <span>
#include <vector>

#include "sim/acoustics/core/energy_histogram.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/paths/early_reflections.h"
#include "sim/acoustics/tracers/path_tracer.h"

namespace earshot {

/// Late field of one source in one scene, for any number of listeners.  Photons are traced from the source; the air is cut into cells
/// (field_grid.h), and each segment adds its length times its energy to the cells that it crosses (track-length estimator of fluence,
/// Spanier and Gelbard 1969, resolved in time, band and direction).  The field at a listener blends the visible cells round it.  Unbiased
/// but for the blur of a cell, mirrors included: no last segment is treated as diffuse.  Against final gathering from patches
/// (docs/explanation/estimators.md, sections 9 and 10): half the error for the same photons, no rays and no noise of its own at the pose, a
/// twentieth of the time per pose.
///
/// Immutable, shared by threads.  All that it holds is one flat image of bytes (native byte order), which may lie in memory or in a mapped
/// file; source_field_store.h keeps such files.
class SourceField {
 public:
  /// From an image that image() gave for the same (scene, source).  `owner` keeps the bytes alive.  Throws InputError if the image is
  /// damaged, of another version, or of another scene, config or source.
  SourceField(const AcousticScene& scene, const EarlyCandidates& candidates, std::span<const std::byte> image,
              std::shared_ptr<const void> owner);

  /// Late field at `listener`, within the bounds of the scene: same meaning, shape and rules of `histogram` as in trace_late.  A function
  /// of (scene, field, listener).  No allocation; 10 to 20 us for half a second, first order.  stats.rays: the photons.
  TraceStats gather(const AcousticScene& scene, glm::vec3 listener, EnergyHistogram& histogram) const;

  [[nodiscard]] std::span<const std::byte> image() const { return image_; }
  [[nodiscard]] std::uint64_t photons() const;
  /// Photons that were ended because they carried something that was not finite.
  [[nodiscard]] std::uint64_t nonfinite_dropped() const;
  /// Relative error of T20, one standard error, over bands and probe positions: the mean noise of the photons and the 90th percentile of
  /// the blur of cells and smoothing (FieldProbes::t20_blur), combined as root of the sum of squares.
  [[nodiscard]] double t20_error() const;

 private:
  std::span<const std::byte> image_;
  std::shared_ptr<const void> owner_;
  std::shared_ptr<const LongChains> long_chains_;  ///< of the source; null without any
};

/// Identity of a field: hash of everything that decides its bits (scene, config, source position, pattern, orientation, radius).
std::uint64_t source_field_key(const AcousticScene& scene, const EarlyCandidates& candidates);

/// How well a field is known at one listener.
struct FieldBatches {
  int count = 0;
  /// [count][bins of the histogram][bands]: energy of a batch of photons over that of the whole field, smoothed as the field is; 1 in the
  /// mean over batches, and where none came.  Independent, each with the noise of 1 / count of the photons of the field.
  std::vector<float> share;
};

/// Photons from which errors are estimated, at most.
inline constexpr std::uint64_t kMostPhotonsOfErrors = 1 << 16;

/// Traces at most kMostPhotonsOfErrors of the photons of `field`, of the same (scene, candidates), once more and holds apart what arrives
/// at `listener`.  Fewer photons than the field has are noisier: the shares are drawn together to what all would have.  A function of
/// (scene, field, listener).  Cost: that of building the field, where it has so few.
FieldBatches field_batches(const AcousticScene& scene, const EarlyCandidates& candidates, const SourceField& field, glm::vec3 listener);

/// A field of so many photons, whatever its error: of other cells the same photons.
std::shared_ptr<const SourceField> build_source_field_of(const AcousticScene& scene, const EarlyCandidates& candidates,
                                                         std::uint64_t photons);

/// Builds a field step by step: each refine() adds photons, at any time a snapshot can be taken.  The bits of snapshot n are a function of
/// (scene, source, n), not of threads or time.  Not thread-safe.
class SourceFieldBuilder {
 public:
  /// Both must outlive this.
  SourceFieldBuilder(const AcousticScene& scene, const EarlyCandidates& candidates);
  ~SourceFieldBuilder();
  SourceFieldBuilder(SourceFieldBuilder&&) noexcept;

  /// Adds photons: the first call 512, later ones what the error needs, an eighth more to four times as many.  False, and nothing done,
  /// if the error target is met or the photons are spent.
  bool refine();
  /// Noise of the photons so far, which more photons lower; the error of the snapshot includes the blur too.
  [[nodiscard]] double t20_error() const;
  [[nodiscard]] std::uint64_t photons() const;
  [[nodiscard]] std::shared_ptr<const SourceField> snapshot() const;

 private:
  friend FieldBatches field_batches(const AcousticScene& scene, const EarlyCandidates& candidates, const SourceField& field,
                                    glm::vec3 listener);
  friend std::shared_ptr<const SourceField> build_source_field_of(const AcousticScene& scene, const EarlyCandidates& candidates,
                                                                  std::uint64_t photons);
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Refines to the target of the config.  progress: called with the fraction done.
std::shared_ptr<const SourceField> build_source_field(const AcousticScene& scene, const EarlyCandidates& candidates,
                                                      const std::function<void(double fraction)>& progress = {});

}  // namespace earshot
