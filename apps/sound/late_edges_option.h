// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "apps/sound/rir_json.h"
#include "sim/acoustics/core/acoustic_config.h"
#include "sim/acoustics/response/late_edges.h"

/// What `earshot rir --late-edges` checks, prints and writes.
namespace earshot {

/// Throws InputError where there is nothing to estimate: without diffraction, or without late sound.
void check_late_edges(const AcousticConfig& config);
/// A line per band.
void print_late_edges(const LateEdges& edges, std::span<const float> bands_hz);
/// Adds late_edges_db, and late_edges_missing where an entry is null (docs/reference/json_output.md, section 1).
void add_late_edges(const LateEdges& edges, OrderedJson& json);

}  // namespace earshot
