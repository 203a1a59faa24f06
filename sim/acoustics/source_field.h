#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <glm/vec3.hpp>
#include <memory>
#include <span>
#include <vector>

#include "sim/acoustics/acoustic_scene.h"
#include "sim/acoustics/early_reflections.h"
#include "sim/acoustics/energy_histogram.h"
#include "sim/acoustics/path_tracer.h"

namespace earshot {

/// Late field of one source in one scene, for any number of listeners: histories of energy over time and band that patches of the surfaces
/// send out, found by tracing photons from the source; a listener sends out a few rays and adds the delayed histories of the patches that
/// they meet (photon map with final gather, Jensen 1996, resolved in time; the construction and its figures: ORACLES 2.9 and 6).
///
/// Immutable, shared by threads.  All that it holds is one flat image of bytes (native byte order), which may lie in memory or in a mapped
/// file; source_field_store.h keeps such files.
class SourceField {
 public:
  /// From an image that image() gave for the same (scene, source).  `owner` keeps the bytes alive.  Throws InputError if the image is
  /// damaged, of another version, or of another scene, config or source.
  SourceField(const AcousticScene& scene, const EarlyCandidates& candidates, std::span<const std::byte> image,
              std::shared_ptr<const void> owner);

  /// Late field at `listener`, what trace_late estimates with diffuse_last_leg off, up to the blur of a patch: same meaning, shape and
  /// rules of `histogram` and TraceStats.  A function of (scene, field, listener).  No allocation; about 0.1 to 0.3 ms.
  TraceStats gather(const AcousticScene& scene, const EarlyCandidates& candidates, glm::vec3 listener, EnergyHistogram& histogram) const;

  [[nodiscard]] std::span<const std::byte> image() const { return image_; }
  [[nodiscard]] std::uint64_t photons() const;
  /// Relative standard error of T20 that the photons leave, mean over bands and probe positions.
  [[nodiscard]] double t20_error() const;

 private:
  std::span<const std::byte> image_;
  std::shared_ptr<const void> owner_;
};

/// Identity of a field: hash of everything that decides its bits (scene, config, source position, pattern, orientation, radius).
std::uint64_t source_field_key(const AcousticScene& scene, const EarlyCandidates& candidates);

/// Builds a field step by step: each refine() adds photons, at any time a snapshot can be taken.  The bits of snapshot n are a function of
/// (scene, source, n), not of threads or time.  Not thread-safe.
class SourceFieldBuilder {
 public:
  /// Both must outlive this.
  SourceFieldBuilder(const AcousticScene& scene, const EarlyCandidates& candidates);
  ~SourceFieldBuilder();
  SourceFieldBuilder(SourceFieldBuilder&&) noexcept;

  /// Adds photons: the first call a batch, later ones as many as there are.  False, and nothing done, if the error target is met or the
  /// photons are spent.
  bool refine();
  [[nodiscard]] double t20_error() const;
  [[nodiscard]] std::uint64_t photons() const;
  [[nodiscard]] std::shared_ptr<const SourceField> snapshot() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Refines to the target of the config.  progress: called with the share done.
std::shared_ptr<const SourceField> build_source_field(const AcousticScene& scene, const EarlyCandidates& candidates,
                                                      const std::function<void(double share)>& progress = {});

}  // namespace earshot
