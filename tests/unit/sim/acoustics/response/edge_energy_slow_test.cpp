// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>

#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/paths/line_of_sight.h"
#include "sim/acoustics/response/energy_response.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

/// A box whose faces are grids of 2 x 3 quads, 72 triangles.
void append_grid_box(TriangleMesh& mesh, glm::dvec3 lower, glm::dvec3 upper) {
  const glm::dvec3 size = upper - lower;
  for (int axis = 0; axis < 3; ++axis) {
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    for (const bool far : {false, true})
      for (int i = 0; i < 2; ++i)
        for (int j = 0; j < 3; ++j) {
          const auto corner = [&](int a, int b) {
            glm::dvec3 p = lower;
            p[axis] = far ? upper[axis] : lower[axis];
            p[u] += size[u] * (i + a) / 2;
            p[v] += size[v] * (j + b) / 3;
            return rooms::point(p.x, p.y, p.z);
          };
          rooms::append_quad(mesh, {corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)}, 1);
        }
  }
}

/// 60 tables with four chairs each in a hall of 24 x 16 x 3.5 m: 78,000 triangles and thousands of edges of 0.25 to 1.2 m.
TriangleMesh restaurant() {
  TriangleMesh mesh;
  rooms::append_box(mesh, {0, 0, 0}, {24, 16, 3.5}, 0);
  const auto box = [&](double x, double y, double z, double dx, double dy, double dz) {
    append_grid_box(mesh, {x - dx / 2, y - dy / 2, z}, {x + dx / 2, y + dy / 2, z + dz});
  };
  for (int i = 0; i < 10; ++i)
    for (int j = 0; j < 6; ++j) {
      const double x = 1.6 + 2.3 * i + 0.05 * (j % 3), y = 1.7 + 2.5 * j + 0.04 * (i % 4);
      box(x, y, 0.72, 1.2, 0.8, 0.03);
      box(x, y, 0.001, 0.3, 0.3, 0.71);
      for (const int side : {-1, 1})
        for (const double along : {-0.3, 0.3}) {
          const double cx = x + along, cy = y + side * 0.62;
          box(cx, cy, 0.45, 0.42, 0.42, 0.03);
          box(cx, cy + side * 0.195, 0.49, 0.42, 0.03, 0.42);
          box(cx - 0.19, cy, 0.001, 0.03, 0.4, 0.44);
          box(cx + 0.19, cy, 0.001, 0.03, 0.4, 0.44);
        }
    }
  return mesh;
}

TEST(EdgeEnergySlow, FastAndHighAgreeInARestaurant) {
  TriangleMesh mesh = restaurant();
  ASSERT_GT(mesh.triangles.size(), 70'000u);
  const auto geometry = rooms::scene_of(std::move(mesh), {Material::uniform("wall", 0.25f, 0.3f), Material::uniform("wood", 0.1f, 0.3f)});
  AcousticConfig fast_config = acoustic_preset("fast"), high_config = acoustic_preset("high");
  fast_config.rir_length_s = high_config.rir_length_s = 1.f;
  AcousticConfig fast_off = fast_config, high_off = high_config;
  fast_off.diffraction = high_off.diffraction = Switch::off;
  const std::array<AcousticScene, 2> fast = {AcousticScene(geometry, fast_config), AcousticScene(geometry, fast_off)},
                                     high = {AcousticScene(geometry, high_config), AcousticScene(geometry, high_off)};
  EXPECT_GT(high[0].diffraction_edges()->size(), 5'000u);
  const glm::vec3 source = rooms::point(3, 3, 1.3);
  const std::array<glm::vec3, 4> listeners = {rooms::point(5, 4, 1.2), rooms::point(8, 7, 1.5), rooms::point(14, 5, 1.2),
                                              rooms::point(21, 13, 1.6)};
  // [place][with edges, without].  Rays of `fast` are few: the mean of the energy over 64 seeds, as that of levels hangs on seeds that miss
  // most of it.  The same rays with edges and without: what edges change is free of their noise.
  std::array<std::array<double, 2>, 4> fast_db{}, high_db{};
  EnergyResponse response;
  for (std::size_t off = 0; off < 2; ++off) {
    const EarlyCandidates by_fast(fast[off], source), by_high(high[off], source);
    for (std::size_t place = 0; place < listeners.size(); ++place) {
      ASSERT_TRUE(in_line_of_sight(high[off], source, listeners[place]));
      compute_energy_response(high[off], by_high, listeners[place], response);
      high_db[place][off] = *measure(high[off], response).drr_db;
      constexpr int seeds = 64;
      double ratio = 0;
      for (int seed = 0; seed < seeds; ++seed) {
        const AcousticScene again = fast[off].with_rays(fast_config.rays, static_cast<std::uint64_t>(seed));
        compute_energy_response(again, by_fast, listeners[place], response);
        ratio += std::pow(10, -0.1 * *measure(again, response).drr_db) / seeds;
      }
      fast_db[place][off] = -10 * std::log10(ratio);
    }
  }
  double mean_db = 0;
  for (std::size_t place = 0; place < listeners.size(); ++place) {
    const auto &f = fast_db[place], &h = high_db[place];
    std::printf("%.1f m: DRR of fast %.2f, of high %.2f dB; edges change them by %.2f and %.2f dB\n",
                static_cast<double>(glm::length(listeners[place] - source)), f[0], h[0], f[0] - f[1], h[0] - h[1]);
    EXPECT_NEAR(f[0] - f[1], h[0] - h[1], 1.0) << "what edges change";
    mean_db += (f[0] - h[0]) / static_cast<double>(listeners.size());
    EXPECT_NEAR(f[0], h[0], 1.0);
  }
  EXPECT_LT(std::abs(mean_db), 0.5);
}

}  // namespace
}  // namespace earshot
