// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <glm/geometric.hpp>
#include <memory>
#include <string>
#include <vector>

#include "sim/base/random.h"
#include "sim/scene/appearance.h"
#include "sim/vision/egl_renderer.h"
#include "sim/vision/embree_camera.h"

namespace earshot::camera_agreement {

/// A scene with its looks.
struct Stage {
  std::shared_ptr<const Scene> scene;
  std::shared_ptr<const Appearance> appearance;
};
inline Stage load_stage(const std::string& spec) {
  const auto scene = std::make_shared<const Scene>(load_scene(spec));
  return {scene, load_appearance(*scene)};
}

/// Pictures of one view, all sensors.
struct Album {
  std::vector<float> depth, normals;
  std::vector<std::uint8_t> rgb;
  std::vector<std::uint16_t> semantic;
  explicit Album(const CameraSensorConfig& config) {
    const auto pixels = static_cast<std::size_t>(config.width_px) * static_cast<std::size_t>(config.height_px);
    depth.assign(pixels, -1.f);
    normals.assign(3 * pixels, -9.f);
    rgb.assign(3 * pixels, 1);
    semantic.assign(pixels, 60000);
  }
  CameraImages images() { return {.depth = depth, .rgb = rgb, .semantic = semantic, .normals = normals}; }
};

/// Poses whose eye, height_m above them, has room around it: no surface within 0.15 m, and none of the rays around it escapes sideways.
inline std::vector<Pose> find_poses(const Scene& scene, int count, float height_m, std::uint64_t seed) {
  std::vector<Pose> poses;
  const Bounds bounds = scene.bounds();
  for (std::uint32_t i = 0; poses.size() < static_cast<std::size_t>(count) && i < 20000; ++i) {
    const RandomStream random(seed, Purpose::test, i);
    const auto u = random.uniform4(0);
    const glm::vec3 size = bounds.upper - bounds.lower;
    const glm::vec3 eye(bounds.lower.x + u[0] * size.x, bounds.lower.y + std::min(height_m, 0.6f * size.y), bounds.lower.z + u[1] * size.z);
    bool clear = true;
    for (int x = -1; x <= 1 && clear; ++x)
      for (int y = -1; y <= 1 && clear; ++y)
        for (int z = -1; z <= 1 && clear; ++z) {
          if (x == 0 && y == 0 && z == 0) continue;
          const Hit hit = scene.rays().intersect(eye, glm::normalize(glm::vec3(x, y, z)));
          clear = hit.valid() ? hit.distance_m > 0.15f : y != 0;
        }
    if (clear) poses.push_back({.position = eye - glm::vec3(0, height_m, 0), .heading_rad = 6.283 * u[2]});
  }
  return poses;
}

/// Shares of pixels on which two albums agree: depth within 1e-3 of itself, colours within 2 of 255 in every channel, the same category,
/// normals within 1e-3.
struct Shares {
  double depth = 0, rgb = 0, semantic = 0, normals = 0;
};
inline Shares compare(const std::vector<Album>& a, const std::vector<Album>& b) {
  Shares shares;
  std::size_t pixels = 0;
  for (std::size_t view = 0; view < a.size(); ++view) {
    for (std::size_t i = 0; i < a[view].depth.size(); ++i, ++pixels) {
      shares.depth += std::fabs(a[view].depth[i] - b[view].depth[i]) <= 1e-3f * a[view].depth[i];
      shares.semantic += a[view].semantic[i] == b[view].semantic[i];
      bool same_color = true, same_normal = true;
      for (std::size_t c = 3 * i; c < 3 * i + 3; ++c) {
        same_color = same_color && std::abs(int{a[view].rgb[c]} - int{b[view].rgb[c]}) <= 2;
        same_normal = same_normal && std::fabs(a[view].normals[c] - b[view].normals[c]) <= 1e-3f;
      }
      shares.rgb += same_color;
      shares.normals += same_normal;
    }
  }
  for (double* share : {&shares.depth, &shares.rgb, &shares.semantic, &shares.normals})
    *share /= static_cast<double>(std::max<std::size_t>(pixels, 1));
  return shares;
}

/// All sensors of both renderers at these poses.
inline Shares agreement(EglRenderer& egl, const Stage& stage, const CameraSensorConfig& config, const std::vector<Pose>& poses) {
  const EmbreeCamera embree(config);
  std::vector<Album> cast, drawn;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    cast.emplace_back(config);
    drawn.emplace_back(config);
  }
  std::vector<EglView> views;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    embree.render(*stage.scene, stage.appearance.get(), poses[i], cast[i].images());
    views.push_back({stage.scene, stage.appearance, poses[i], drawn[i].images()});
  }
  egl.render(config, views);
  return compare(cast, drawn);
}

}  // namespace earshot::camera_agreement
