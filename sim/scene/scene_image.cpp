// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/scene_image.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <type_traits>
#include <utility>
#include <vector>

#include "sim/base/byte_stream.h"
#include "sim/scene/mesh/flat_patches.h"

namespace earshot {
namespace {

constexpr std::uint64_t kMaxTexts = 1 << 24;

void put_texts(ByteWriter& writer, const std::vector<std::string>& texts) {
  writer.put(static_cast<std::uint64_t>(texts.size()));
  for (const std::string& text : texts) writer.put_text(text);
}

std::vector<std::string> take_texts(ByteReader& reader) {
  const auto count = reader.take<std::uint64_t>();
  reader.check(count <= kMaxTexts);
  std::vector<std::string> texts;
  for (std::uint64_t i = 0; i < count; ++i) texts.push_back(reader.take_text());
  return texts;
}

void put_curve(ByteWriter& writer, const CoefficientCurve& curve) {
  writer.put_list(curve.hz);
  writer.put_list(curve.value);
}

CoefficientCurve take_curve(ByteReader& reader) {
  CoefficientCurve curve{.hz = reader.take_list<float>(), .value = reader.take_list<float>()};
  reader.check(curve.hz.size() == curve.value.size() && std::is_sorted(curve.hz.begin(), curve.hz.end()));
  for (const float hz : curve.hz) reader.check(hz > 0 && std::isfinite(hz));
  for (const float value : curve.value) reader.check(std::isfinite(value));
  return curve;
}

void put_material(ByteWriter& writer, const Material& material) {
  writer.put_text(material.name);
  put_texts(writer, material.labels);
  for (const CoefficientCurve* curve : {&material.absorption, &material.scattering, &material.transmission, &material.damping_db_per_m,
                                        &material.impedance_real, &material.impedance_imaginary})
    put_curve(writer, *curve);
  writer.put(static_cast<std::uint8_t>(material.locally_reacting));
  writer.put(material.speed_m_per_s);
  writer.put(material.density_kg_per_m3);
  writer.put_text(material.source);
  writer.put(static_cast<std::uint64_t>(material.sources.size()));
  for (const auto& [key, text] : material.sources) {
    writer.put_text(key);
    writer.put_text(text);
  }
  writer.put_text(material.category);
}

Material take_material(ByteReader& reader) {
  Material material;
  material.name = reader.take_text();
  material.labels = take_texts(reader);
  for (CoefficientCurve* curve : {&material.absorption, &material.scattering, &material.transmission, &material.damping_db_per_m,
                                  &material.impedance_real, &material.impedance_imaginary})
    *curve = take_curve(reader);
  const auto locally_reacting = reader.take<std::uint8_t>();
  reader.check(locally_reacting <= 1 && material.impedance_real.hz == material.impedance_imaginary.hz);
  for (const float real : material.impedance_real.value) reader.check(real > 0);
  material.locally_reacting = locally_reacting == 1;
  material.speed_m_per_s = reader.take<float>();
  material.density_kg_per_m3 = reader.take<float>();
  material.source = reader.take_text();
  for (auto left = reader.take<std::uint64_t>(); left > 0; --left) {
    std::string key = reader.take_text();
    material.sources[std::move(key)] = reader.take_text();
  }
  material.category = reader.take_text();
  return material;
}

/// The fields of a report on a point cloud, one by one.
template <class Report, class Visit>
void visit_cloud(Report& cloud, Visit visit) {
  visit(cloud.points);
  visit(cloud.invalid_points);
  visit(cloud.stray_points);
  visit(cloud.cell_m);
  visit(cloud.is_cell_given);
  visit(cloud.spacing_m);
  visit(cloud.closed_width_m);
  visit(cloud.holes);
  visit(cloud.hole_area_m2);
  visit(cloud.air_m3);
  visit(cloud.unseen_m3);
}

void put_report(ByteWriter& writer, const ImportReport& report) {
  for (const std::uint64_t count : {report.triangles_read, report.degenerate_removed, report.duplicate_removed, report.vertices_welded})
    writer.put(count);
  writer.put(static_cast<std::uint8_t>(report.simplified.has_value()));
  const SimplifyReport simplified = report.simplified.value_or(SimplifyReport{});
  writer.put(simplified.triangles_before);
  writer.put(simplified.triangles_after);
  writer.put(simplified.deviation_m);
  put_texts(writer, report.warnings);
  writer.put(static_cast<std::uint64_t>(report.choices.size()));
  for (const MaterialChoice& choice : report.choices) {
    writer.put(static_cast<std::uint8_t>(choice.reason));
    writer.put_text(choice.by);
    writer.put(static_cast<std::uint8_t>(choice.has_category));
  }
  writer.put(static_cast<std::uint8_t>(report.has_semantics));
  writer.put(static_cast<std::uint8_t>(report.axes.has_value()));
  const FileAxes axes = report.axes.value_or(FileAxes{});
  writer.put(axes.unit_m);
  for (const char flag : {axes.up, static_cast<char>(axes.is_unit_given), static_cast<char>(axes.is_up_given)}) writer.put(flag);
  writer.put(static_cast<std::uint8_t>(report.cloud.has_value()));
  if (report.cloud) visit_cloud(*report.cloud, [&](const auto& value) { writer.put(value); });
}

MaterialChoice take_choice(ByteReader& reader) {
  MaterialChoice choice;
  const auto reason = reader.take<std::uint8_t>();
  reader.check(reason <= static_cast<std::uint8_t>(MaterialReason::fallback));
  choice.reason = static_cast<MaterialReason>(reason);
  choice.by = reader.take_text();
  choice.has_category = reader.take<std::uint8_t>() != 0;
  return choice;
}

ImportReport take_report(ByteReader& reader) {
  ImportReport report;
  for (std::uint64_t* count : {&report.triangles_read, &report.degenerate_removed, &report.duplicate_removed, &report.vertices_welded})
    *count = reader.take<std::uint64_t>();
  const bool simplified = reader.take<std::uint8_t>() != 0;
  SimplifyReport simplification;
  simplification.triangles_before = reader.take<std::uint64_t>();
  simplification.triangles_after = reader.take<std::uint64_t>();
  simplification.deviation_m = reader.take<double>();
  if (simplified) report.simplified = simplification;
  report.warnings = take_texts(reader);
  const auto count = reader.take<std::uint64_t>();
  reader.check(count <= kMaxTexts);
  for (std::uint64_t i = 0; i < count; ++i) report.choices.push_back(take_choice(reader));
  report.has_semantics = reader.take<std::uint8_t>() != 0;
  const bool has_axes = reader.take<std::uint8_t>() != 0;
  FileAxes axes;
  axes.unit_m = reader.take<double>();
  axes.up = reader.take<char>();
  axes.is_unit_given = reader.take<char>() != 0;
  axes.is_up_given = reader.take<char>() != 0;
  if (has_axes) report.axes = axes;
  if (reader.take<std::uint8_t>() != 0)
    visit_cloud(report.cloud.emplace(), [&]<class Value>(Value& value) {
      if constexpr (std::is_same_v<Value, bool>)
        value = reader.take<std::uint8_t>() != 0;
      else
        value = reader.take<Value>();
    });
  return report;
}

bool all_below(const std::vector<std::uint32_t>& indices, std::size_t end) {
  // One pass without a branch: these are the largest arrays.
  std::uint32_t largest = 0;
  for (const std::uint32_t index : indices) largest = std::max(largest, index);
  return indices.empty() || largest < end;
}

bool all_below(const std::vector<glm::uvec3>& triangles, std::size_t end) {
  std::uint32_t largest = 0;
  for (const glm::uvec3 triangle : triangles) largest = std::max(largest, std::max(triangle.x, std::max(triangle.y, triangle.z)));
  return triangles.empty() || largest < end;
}

TriangleMesh take_mesh(ByteReader& reader) {
  TriangleMesh mesh;
  mesh.vertices = reader.take_list<glm::vec3>();
  mesh.triangles = reader.take_list<glm::uvec3>();
  mesh.triangle_material = reader.take_list<std::uint32_t>();
  mesh.triangle_object = reader.take_list<std::uint32_t>();
  mesh.material_names = take_texts(reader);
  mesh.object_names = take_texts(reader);
  mesh.origin_m = reader.take<glm::dvec3>();
  const std::size_t count = mesh.triangles.size();
  reader.check(mesh.triangle_material.size() == count && mesh.triangle_object.size() == count);
  reader.check(all_below(mesh.triangles, mesh.vertices.size()));
  reader.check(all_below(mesh.triangle_material, mesh.material_names.size()));
  reader.check(all_below(mesh.triangle_object, mesh.object_names.size()));
  // Scenes end at 1e9 m; not so for NaN.
  bool near = true;
  for (const glm::vec3& v : mesh.vertices) near &= std::fabs(v.x) <= 2e9f && std::fabs(v.y) <= 2e9f && std::fabs(v.z) <= 2e9f;
  for (int axis = 0; axis < 3; ++axis) near &= std::fabs(mesh.origin_m[axis]) <= 2e9;
  reader.check(near);
  return mesh;
}

RaySurface take_surface(ByteReader& reader, const TriangleMesh& mesh) {
  RaySurface surface{.triangles = reader.take_list<glm::uvec3>(), .stands_for = reader.take_list<std::uint32_t>()};
  reader.check(surface.triangles.size() == surface.stands_for.size() && surface.triangles.empty() == mesh.triangles.empty());
  reader.check(all_below(surface.triangles, mesh.vertices.size()) && all_below(surface.stands_for, mesh.triangles.size()));
  return surface;
}

}  // namespace

std::string encode_scene(const Scene& scene) {
  static_assert(std::is_trivially_copyable_v<Air> && sizeof(Air) == 4 * sizeof(float));
  ByteWriter writer;
  writer.put_text(scene.name());
  writer.put(scene.air());
  const TriangleMesh& mesh = scene.mesh();
  writer.put_list(mesh.vertices);
  writer.put_list(mesh.triangles);
  writer.put_list(mesh.triangle_material);
  writer.put_list(mesh.triangle_object);
  put_texts(writer, mesh.material_names);
  put_texts(writer, mesh.object_names);
  writer.put(mesh.origin_m);
  writer.put_list(scene.rays().traced());
  std::vector<std::uint32_t> stands_for(scene.rays().num_triangles());
  for (std::uint32_t i = 0; i < stands_for.size(); ++i) stands_for[i] = scene.rays().stands_for(i);
  writer.put_list(stands_for);
  for (const Material& material : scene.materials()) put_material(writer, material);
  put_report(writer, scene.import_report());
  writer.put(scene.hash());
  return writer.take();
}

Scene decode_scene(std::string_view bytes, const std::string& where) {
  ByteReader reader(bytes, where, "is not a scene");
  std::string name = reader.take_text();
  const Air air = reader.take<Air>();
  for (const float value : {air.temperature_c, air.humidity_percent, air.pressure_kpa, air.speed_of_sound_m_per_s})
    reader.check(std::isfinite(value));
  reader.check(air.temperature_c > -273 && air.speed_of_sound_m_per_s >= 0);
  TriangleMesh mesh = take_mesh(reader);
  const RaySurface surface = take_surface(reader, mesh);
  std::vector<Material> materials;
  for (std::size_t slot = 0; slot < mesh.material_names.size(); ++slot) materials.push_back(take_material(reader));
  ImportReport report = take_report(reader);
  const auto hash = reader.take<std::uint64_t>();
  reader.finish();
  Scene scene(std::move(name), std::move(mesh), surface, std::move(materials), air, std::move(report));
  reader.check(scene.hash() == hash);
  return scene;
}

}  // namespace earshot
