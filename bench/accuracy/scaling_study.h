// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

namespace earshot {

/// Cost of a scene of a given size under the preset `fast`, on one thread.
struct ScalingRow {
  std::string spec;
  std::size_t triangles = 0;
  double load_ms = 0;     ///< SCENE to triangles and BVH
  double prepare_ms = 0;  ///< surfaces, edges, effect plan, grid of the field
  double memory_mb = 0;   ///< growth of resident memory by both, MB of 10^6 bytes; without memory that the kernel had not returned before
  double per_source_ms = 0, per_rir_ms = 0;
};

/// Several sources that one listener hears.
struct SourcesRow {
  int sources = 0;
  double per_source_ms = 0;    ///< mean over the sources
  double per_response_ms = 0;  ///< all of them, rendered for two ears, warm
};

struct ScalingStudy {
  std::vector<ScalingRow> scenes;
  std::string sources_spec;
  std::vector<SourcesRow> sources;
};

/// Question: how do time and memory grow with triangles and sources?  Generated houses of one plan.  quick: the two smallest, two sources.
ScalingStudy run_scaling_study(bool quick, const std::function<void(const std::string& stage)>& progress = {});
/// Two tables.
std::string scaling_markdown(const ScalingStudy& study);

/// Resident memory of this process in bytes, after what is free has been given back.
double resident_bytes();

}  // namespace earshot
