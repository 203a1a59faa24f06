// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/acoustic_image.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <type_traits>
#include <utility>
#include <vector>

#include "sim/acoustics/model/plane_cells.h"
#include "sim/base/byte_stream.h"

namespace earshot {
namespace {

// Written as they lie in memory, so without padding.
static_assert(std::is_trivially_copyable_v<MirrorPlane> && sizeof(MirrorPlane) == 12 * 4);
static_assert(std::is_trivially_copyable_v<DiffractionEdge> && sizeof(DiffractionEdge) == 19 * 8 + 2 * 4);

void put_geometry(ByteWriter& writer, const FoundGeometry& found) {
  writer.put_list(found.edges);
  writer.put_list(found.planes.planes);
  writer.put_list(found.planes.plane_of_triangle);
  writer.put_list(found.folds.planes);
  writer.put_list(found.folds.depth_m);
  writer.put_list(found.folds.some_plane);
  writer.put_list(found.folds.fold_of_triangle);
  writer.put_list(found.mean_absorption);
  writer.put_list(found.solid);
}

bool all_below(const std::vector<std::uint32_t>& indices, std::size_t end) {
  std::uint32_t largest = 0;
  for (const std::uint32_t index : indices) largest = std::max(largest, index);
  return indices.empty() || largest < end;
}

bool is_unit(glm::dvec3 v) { return std::abs(glm::dot(v, v) - 1) < 1e-3; }

bool is_finite(glm::vec3 v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

bool are_planes(const std::vector<MirrorPlane>& planes, std::size_t materials) {
  return std::all_of(planes.begin(), planes.end(), [&](const MirrorPlane& plane) {
    return plane.material < materials && is_finite(plane.normal) && std::isfinite(plane.offset_m) && std::isfinite(plane.area_m2) &&
           is_finite(plane.bounds.lower) && is_finite(plane.bounds.upper);
  });
}

bool is_edge(const DiffractionEdge& edge, std::size_t materials) {
  constexpr double full_rad = 2 * std::numbers::pi + 1e-6;
  return edge.first_material < materials && edge.second_material < materials && is_unit(edge.along) && is_unit(edge.face) &&
         is_unit(edge.first_normal) && is_unit(edge.second_normal) && std::abs(edge.start.x) < 1e10 && std::abs(edge.start.y) < 1e10 &&
         std::abs(edge.start.z) < 1e10 && edge.length_m > 0 && edge.length_m < 1e10 && edge.exterior_rad > 3 &&
         edge.exterior_rad <= full_rad && edge.first_width_m > 0 && edge.first_width_m <= kWideFaceM && edge.second_width_m > 0 &&
         edge.second_width_m <= kWideFaceM;
}

FoundGeometry take_geometry(ByteReader& reader, const Scene& scene) {
  FoundGeometry found;
  found.edges = reader.take_list<DiffractionEdge>();
  found.planes.planes = reader.take_list<MirrorPlane>();
  found.planes.plane_of_triangle = reader.take_list<std::uint32_t>();
  found.folds.planes = reader.take_list<MirrorPlane>();
  found.folds.depth_m = reader.take_list<float>();
  found.folds.some_plane = reader.take_list<std::uint32_t>();
  found.folds.fold_of_triangle = reader.take_list<std::uint32_t>();
  found.mean_absorption = reader.take_list<double>();
  found.solid = reader.take_list<std::uint8_t>();

  const std::size_t triangles = scene.mesh().triangles.size(), materials = scene.materials().size();
  for (const DiffractionEdge& edge : found.edges) reader.check(is_edge(edge, materials));
  reader.check(found.planes.plane_of_triangle.size() == triangles && are_planes(found.planes.planes, materials) &&
               all_below(found.planes.plane_of_triangle, found.planes.planes.size()));
  const FoldedPlanes& folds = found.folds;
  reader.check(are_planes(folds.planes, materials) && folds.depth_m.size() == folds.planes.size() &&
               folds.some_plane.size() == folds.planes.size() && all_below(folds.some_plane, found.planes.planes.size()));
  reader.check(folds.fold_of_triangle.size() == (folds.planes.empty() ? 0 : triangles) &&
               all_below(folds.fold_of_triangle, folds.planes.size() + 1));
  for (const float depth_m : folds.depth_m) reader.check(depth_m >= 0 && std::isfinite(depth_m));
  reader.check(found.solid.empty() || found.solid.size() == triangles);
  for (const double mean : found.mean_absorption) reader.check(mean >= 0 && mean <= 1.0001);
  return found;
}

void put_plan(ByteWriter& writer, const EffectPlan& plan) {
  writer.put(static_cast<std::uint64_t>(plan.decisions.size()));
  for (const EffectDecision& decision : plan.decisions) {
    writer.put_text(decision.effect);
    writer.put_text(decision.decision);
    writer.put(static_cast<std::uint8_t>(decision.on));
    writer.put(decision.change);
    writer.put_text(decision.unit);
    writer.put(decision.kind);
    writer.put(decision.saved_ms);
    writer.put_text(decision.why);
  }
  for (const bool air : plan.air) writer.put(static_cast<std::uint8_t>(air));
  for (const bool on : {plan.late, plan.diffraction, plan.straight_transmission, plan.traced_transmission, plan.field, plan.wall_power})
    writer.put(static_cast<std::uint8_t>(on));
  writer.put(plan.image_order);
  writer.put(plan.rir_length_s);
  writer.put(plan.source_radius_m);
  writer.put(plan.mean_free_path_m);
}

bool take_bool(ByteReader& reader) {
  const auto value = reader.take<std::uint8_t>();
  reader.check(value <= 1);
  return value == 1;
}

EffectPlan take_plan(ByteReader& reader) {
  EffectPlan plan;
  for (auto left = reader.take<std::uint64_t>(); left > 0; --left) {
    EffectDecision& decision = plan.decisions.emplace_back();
    decision.effect = reader.take_text();
    decision.decision = reader.take_text();
    decision.on = take_bool(reader);
    decision.change = reader.take<double>();
    decision.unit = reader.take_text();
    const auto kind = reader.take<std::underlying_type_t<BoundKind>>();
    reader.check(kind <= static_cast<std::underlying_type_t<BoundKind>>(BoundKind::user_set));
    decision.kind = static_cast<BoundKind>(kind);
    decision.saved_ms = reader.take<double>();
    decision.why = reader.take_text();
  }
  for (bool& air : plan.air) air = take_bool(reader);
  for (bool* on : {&plan.late, &plan.diffraction, &plan.straight_transmission, &plan.traced_transmission, &plan.field, &plan.wall_power})
    *on = take_bool(reader);
  plan.image_order = reader.take<int>();
  plan.rir_length_s = reader.take<float>();
  plan.source_radius_m = reader.take<float>();
  plan.mean_free_path_m = reader.take<double>();
  reader.check(plan.image_order >= 0 && plan.image_order <= PlaneSequence::kMaxOrder);
  reader.check(plan.rir_length_s > 0 && plan.rir_length_s <= 60 && plan.source_radius_m > 0 && plan.source_radius_m < 1e9f);
  reader.check(plan.mean_free_path_m >= 0 && plan.mean_free_path_m < 1e10);
  return plan;
}

}  // namespace

std::string encode_acoustics(const AcousticScene& scene) {
  ByteWriter writer;
  writer.put(scene.scene().hash());
  put_geometry(writer, scene.surfaces().found());
  put_plan(writer, scene.plan());
  return writer.take();
}

AcousticScene decode_acoustics(std::string_view bytes, std::shared_ptr<const Scene> scene, const AcousticConfig& config,
                               const std::string& where) {
  ByteReader reader(bytes, where, "is not an acoustic image of this scene");
  reader.check(reader.take<std::uint64_t>() == scene->hash());
  FoundGeometry found = take_geometry(reader, *scene);
  EffectPlan plan = take_plan(reader);
  reader.finish();
  reader.check(config.diffraction != Switch::off || found.edges.empty());
  const std::size_t mean_count = found.mean_absorption.size();
  AcousticSurfaces surfaces(std::move(scene), config, std::move(found));
  reader.check(mean_count == static_cast<std::size_t>(surfaces.num_bands()));
  return {std::move(surfaces), std::move(plan)};
}

}  // namespace earshot
