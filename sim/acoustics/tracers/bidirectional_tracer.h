// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "sim/acoustics/core/energy_histogram.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/paths/early_reflections.h"
#include "sim/acoustics/tracers/path_tracer.h"

namespace earshot {

/// Independent estimates of one late field, each from its part of the rays; their mean is the field.  For standard errors.
struct LateBatches {
  int count = 0, num_bins = 0, num_bands = 0;
  std::vector<float> energy;  ///< [count][num_bins][num_bands], Green units
  /// [num_bins][num_bands], or empty: standard error of chains of mirrors that no batch has found, beside the spread of the batches, Green
  /// units; 0 where no ray stood that had met mirrors alone.
  std::vector<float> unseen;

  [[nodiscard]] float at(int batch, int bin, int band) const {
    return energy[(static_cast<std::size_t>(batch) * num_bins + bin) * num_bands + band];
  }
  void scale(std::span<const float> factor);  ///< energy of each band
  void clear() { count = 0, energy.clear(), unseen.clear(); }
};

struct BidirectionalOptions {
  /// Called with the fraction that is done, in (0, 1], never falling; from worker threads, one at a time.
  std::function<void(double fraction)> progress = {};
  /// Kinds of connection; all on except for tests.  Without next_event, source_bounces must reach max_bounces or long paths are lost.
  bool next_event = true, connection = true, to_listener = true;
  bool short_edges = false;  ///< connect surfaces nearer to each other than the radius of the source's sphere too; only for tests
};

/// Reference for the late field: bidirectional path tracing in bands.  config.source_rays paths from the source, of up to
/// config.source_bounces events each, are traced and kept; config.rays listener rays are traced; each listener vertex is connected to
/// the source and to one random vertex of one source path, each source vertex to the listener; weights by the balance heuristic over all
/// strategies (mis_weight.h; docs/explanation/estimators.md, section 4).  What trace_late promises holds here too (units, what is left out,
/// same bits for any number of threads), with these differences:
///  - Specular reflections: a mirror, or with config.specular_exponent a lobe that connections see and image paths do not
///  (specular_lobe.h).
///  - Transmission: where traces_transmission(scene), rays pass walls with a probability of the mean over bands of tau over what is kept.
///    The straight line through walls is left out (find_transmitted carries it).
///  - Paths of which no strategy can connect an edge (mirror at both ends of everything diffuse) are caught by the source's sphere, whose
///    radius is candidates.sound_source().radius_m, or config.source_radius_m for a point; no path is counted both ways.  Edges between
///    surfaces shorter than that radius are not connected: near corners the square of such a contribution has no mean.
///  - With fewer source paths than listener rays only so many of the listener's vertices are connected, a quarter at least; all rays meet
///    the sphere.
///  - config.diffuse_last_segment is ignored: the result is unbiased, up to the extent of that sphere.
///  - Rays and source paths are dealt out to 16 batches, independent of each other; `batches` gets their estimates if it is given.
/// With source_rays = 0 only next-event estimation is left.
TraceStats trace_bidirectional(const AcousticScene& scene, const EarlyCandidates& candidates, glm::vec3 listener,
                               EnergyHistogram& histogram, LateBatches* batches = nullptr, const BidirectionalOptions& options = {});

}  // namespace earshot
