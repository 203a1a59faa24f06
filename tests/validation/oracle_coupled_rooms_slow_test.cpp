// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cstdio>

#include "tests/support/acoustics/decay.h"
#include "tests/support/acoustics/late_field.h"

// docs/evidence/oracles.md, O-21: a dead room of 60 m3 and a live one of 210 m3 that share a doorway of 2 m2.
namespace earshot {
namespace {

constexpr double kBinS = 0.004;
constexpr int kSeeds = 8;

std::shared_ptr<const Scene> coupled_rooms() {
  TriangleMesh mesh;
  // A rectangle in the plane where axis `normal` is `at`, spanned over the two others in the order x, y, z.
  const auto wall = [&](int normal, double at, double u0, double u1, double v0, double v1, std::uint32_t material) {
    const auto corner = [&](double u, double v) {
      return normal == 0 ? rooms::point(at, u, v) : normal == 1 ? rooms::point(u, at, v) : rooms::point(u, v, at);
    };
    rooms::append_quad(mesh, {corner(u0, v0), corner(u1, v0), corner(u1, v1), corner(u0, v1)}, material);
  };
  // Faces of the wall between the rooms 2 mm apart, as a sheet has one absorption for both sides.
  constexpr double x1 = 5, x2 = 5.002, x3 = 12.002;
  wall(0, 0, 0, 4, 0, 3, 0);
  wall(1, 0, 0, x1, 0, 3, 0), wall(1, 4, 0, x1, 0, 3, 0);
  wall(2, 0, 0, x1, 0, 4, 0), wall(2, 3, 0, x1, 0, 4, 0);
  wall(0, x1, 0, 1.5, 0, 3, 0), wall(0, x1, 2.5, 4, 0, 3, 0), wall(0, x1, 1.5, 2.5, 2, 3, 0);
  wall(0, x3, 0, 6, 0, 5, 1);
  wall(1, 0, x2, x3, 0, 5, 1), wall(1, 6, x2, x3, 0, 5, 1);
  wall(2, 0, x2, x3, 0, 6, 1), wall(2, 5, x2, x3, 0, 6, 1);
  wall(0, x2, 0, 1.5, 0, 5, 1), wall(0, x2, 2.5, 6, 0, 5, 1), wall(0, x2, 1.5, 2.5, 2, 5, 1);
  wall(1, 1.5, x1, x2, 0, 2, 1), wall(1, 2.5, x1, x2, 0, 2, 1), wall(2, 2, x1, x2, 1.5, 2.5, 1), wall(2, 0, x1, x2, 1.5, 2.5, 1);
  return rooms::scene_of(std::move(mesh), {Material::uniform("dead", 0.30f, 1.f), Material::uniform("live", 0.03f, 1.f)});
}

const glm::vec3 kSource1 = rooms::point(3, 3, 1.5), kListener1 = rooms::point(2, 1, 1.2);
const glm::vec3 kSource2 = rooms::point(8.002, 2, 1.5), kListener2 = rooms::point(9.002, 4, 2);

struct Runs {
  std::vector<double> mean;  ///< energy per bin over all seeds
  std::vector<std::vector<double>> seeds;
  [[nodiscard]] decay::Estimate energy() const { return window(0, 1e9); }
  [[nodiscard]] decay::Estimate window(double from_s, double to_s) const {
    std::vector<double> sums;
    for (const auto& series : seeds) {
      double sum = 0;
      for (std::size_t i = 0; i < series.size(); ++i) {
        const double at_s = (static_cast<double>(i) + 0.5) * kBinS;
        if (at_s >= from_s && at_s < to_s) sum += series[i];
      }
      sums.push_back(sum);
    }
    return decay::estimate(sums);
  }
};

Runs run(glm::vec3 source, glm::vec3 listener, int first_seed) {
  static const std::shared_ptr<const Scene> scene = coupled_rooms();
  AcousticConfig config = rooms::plain_config();
  config.rays = 4096;
  config.rir_length_s = 4.6f;  // 3 s are judged; what comes after 4.6 s weighs 0.4 % there
  config.time_bin_s = static_cast<float>(kBinS);
  Runs runs;
  for (int seed = 0; seed < kSeeds; ++seed) {
    config.seed = static_cast<std::uint64_t>(first_seed + seed);
    TraceStats stats;
    runs.seeds.push_back(rooms::late_field(scene, config, source, listener, &stats).band_energy(0));
    EXPECT_GT(stats.ray_efficiency(), 0.99999) << "the rooms must be closed";
  }
  runs.mean.assign(runs.seeds[0].size(), 0.0);
  for (const auto& series : runs.seeds)
    for (std::size_t i = 0; i < series.size(); ++i) runs.mean[i] += series[i] / kSeeds;
  return runs;
}

struct Level {
  double at_s, level_db;
};
void expect_curve(const char* pair, const Runs& runs, std::span<const Level> levels, double energy, double energy_sigma) {
  const std::vector<double> left = decay::curve(runs.mean);
  for (const Level& level : levels) {
    const double traced_db = decay::level_db(left, kBinS, level.at_s);
    std::printf("%s %.1f s: %.2f dB, traced %.2f dB\n", pair, level.at_s, level.level_db, traced_db);
    EXPECT_NEAR(traced_db, level.level_db, 0.3) << pair << " " << level.at_s;
  }
  const decay::Estimate total = runs.energy();
  std::printf("%s energy %.5g +- %.2g, traced %.5g +- %.2g\n", pair, energy, energy_sigma, total.mean, total.standard_error);
  EXPECT_NEAR(total.mean, energy, 4 * std::hypot(total.standard_error, energy_sigma)) << pair;
  EXPECT_LT(total.standard_error, 0.02 * energy) << pair;
}

TEST(OracleO21, CoupledRooms) {
  const Runs dead = run(kSource1, kListener1, 1), across = run(kSource1, kListener2, 101), live = run(kSource2, kListener2, 201),
             back = run(kListener2, kSource1, 301);
  const Level dead_levels[] = {{0.1, -14.77}, {0.2, -18.52}, {0.4, -21.47}, {0.6, -24.47},
                               {0.8, -27.35}, {1.0, -30.10}, {1.5, -37.55}, {2.0, -44.76}};
  const Level across_levels[] = {{0.2, -2.37}, {0.6, -8.23}, {1.0, -14.09}, {2.0, -28.71}, {3.0, -43.42}};
  const Level live_levels[] = {{0.2, -2.72}, {1.0, -14.43}, {3.0, -43.65}};
  expect_curve("1 to 1", dead, dead_levels, 7.109e-3, 0.019e-3);
  expect_curve("1 to 2", across, across_levels, 2.701e-3, 0.011e-3);
  expect_curve("2 to 2", live, live_levels, 3.732e-2, 0.0065e-2);

  // One slow decay everywhere, 4.10 s; without the doorway the live room alone would have 5.3 s and the dead one 0.35 s.
  for (const auto& [name, runs, from_db, to_db] :
       {std::tuple{"1 to 1", &dead, -22, -42}, {"1 to 2", &across, -5, -40}, {"2 to 2", &live, -5, -40}}) {
    const double slow_s = decay::time_s(runs->mean, kBinS, from_db, to_db);
    std::printf("%s slow decay %.3f s\n", name, slow_s);
    EXPECT_NEAR(slow_s, 4.10, 0.02 * 4.10) << name;
  }

  // Reciprocity: source and listener in their places exchanged, every 200 ms.
  for (int w = 0; w < 10; ++w) {
    const decay::Estimate there = across.window(0.2 * w, 0.2 * w + 0.2), here = back.window(0.2 * w, 0.2 * w + 0.2);
    const double sigma = std::hypot(there.standard_error, here.standard_error);
    EXPECT_NEAR(there.mean, here.mean, 4 * sigma) << 200 * w << " ms";
    EXPECT_LT(sigma, 0.05 * there.mean) << "noise must not hide a difference, " << 200 * w << " ms";
  }
  const decay::Estimate one_two = across.energy(), two_one = back.energy();
  std::printf("exchanged: %.5g +- %.2g and %.5g +- %.2g\n", one_two.mean, one_two.standard_error, two_one.mean, two_one.standard_error);
  EXPECT_NEAR(one_two.mean, two_one.mean, 4 * std::hypot(one_two.standard_error, two_one.standard_error));
  EXPECT_LT(two_one.standard_error, 0.02 * two_one.mean);
}

}  // namespace
}  // namespace earshot
