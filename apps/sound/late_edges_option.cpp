// SPDX-License-Identifier: Apache-2.0
#include "apps/sound/late_edges_option.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "sim/base/errors.h"

namespace earshot {

void check_late_edges(const AcousticConfig& config) {
  if (config.diffraction == Switch::off)
    throw InputError("--late-edges", "has no effect with diffraction=off, which leaves out all sound round edges", "leave out one of them");
  if (config.late == Switch::off)
    throw InputError("--late-edges", "has no effect with late=off: there is no late sound", "leave out one of them");
}

void print_late_edges(const LateEdges& edges, std::span<const float> bands_hz) {
  const std::vector<double> change_db = edges.change_db();
  for (std::size_t b = 0; b < std::min(change_db.size(), bands_hz.size()); ++b)
    fmt::print(
        "  {:>6.0f} Hz  late sound round edges: {}\n", bands_hz[b],
        std::isfinite(change_db[b]) ? fmt::format("{:.2f} dB more, loss of lit sides not subtracted", change_db[b]) : "all there is");
}

void add_late_edges(const LateEdges& edges, OrderedJson& json) {
  OrderedJson& change_db = json["late_edges_db"] = OrderedJson::array();
  bool all_finite = true;
  for (const double db : edges.change_db()) {
    change_db.push_back(number_or_null(std::isfinite(db) ? std::optional(db) : std::nullopt));
    all_finite = all_finite && std::isfinite(db);
  }
  if (!all_finite) json["late_edges_missing"] = "rays bring no late sound: all of it goes round edges";
}

}  // namespace earshot
