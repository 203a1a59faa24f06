// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "sim/acoustics/source_field/source_field.h"

namespace earshot {

/// A source field that its own thread refines in the background, for callers that render before the target is met.  The bits of
/// snapshot n are fixed (SourceFieldBuilder), only the moment when it is there is not: with a schedule of snapshots and wait_for, the sound
/// is reproducible; with latest() it depends on the machine.
class RefiningField {
 public:
  /// Starts at once.  Both must outlive this.
  RefiningField(const AcousticScene& scene, const EarlyCandidates& candidates);
  /// Ends after the refinement that is under way.
  ~RefiningField();

  /// Snapshot n, counted from 0: the field after n + 1 refinements; the final one if the target is met earlier.  Blocks until it is there.
  /// Snapshots before n are given up: n must not fall from call to call.  Throws what refining threw.  Thread-safe.
  std::shared_ptr<const SourceField> wait_for(int n);
  /// The final field.
  std::shared_ptr<const SourceField> wait_for_target();
  /// The newest snapshot, null before the first.  Does not block.
  [[nodiscard]] std::shared_ptr<const SourceField> latest() const;
  [[nodiscard]] int num_snapshots() const;  ///< made so far
  [[nodiscard]] bool finished() const;      ///< the target is met, or the photons are spent

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace earshot
