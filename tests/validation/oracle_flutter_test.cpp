// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cstdio>

#include "sim/acoustics/metrics/late_errors.h"
#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/source_field/source_field.h"
#include "tests/support/acoustics/decay.h"
#include "tests/support/acoustics/late_field.h"

// docs/evidence/oracles.md, O-5: two parallel planes 3.43 m apart, open sides.
namespace earshot {
namespace {

constexpr double kGapM = 3.43, kAbsorption = 0.04;

/// Planes of 4 km: the paths of the test meet them within 60 m of the middle.
std::shared_ptr<const Scene> two_planes() {
  const double r = 2000;
  TriangleMesh mesh;
  for (int plane = 0; plane < 2; ++plane) {
    const double x = plane * kGapM;
    rooms::append_quad(mesh, {rooms::point(x, -r, -r), rooms::point(x, r, -r), rooms::point(x, r, r), rooms::point(x, -r, r)}, plane);
  }
  const Material wall = Material::uniform("wall", static_cast<float>(kAbsorption), 0.f);
  return rooms::scene_of(std::move(mesh), {wall, wall});
}

glm::vec3 source() { return rooms::point(1.2, 0, 0); }
glm::vec3 listener() { return rooms::point(2.0, 1.5, 0); }

AcousticConfig flutter_config() {
  AcousticConfig config = rooms::plain_config();
  config.early = Switch::automatic;
  config.early_order = 4;
  config.rir_length_s = 0.5f;
  config.time_bin_s = 0.001f;
  return config;
}

TEST(OracleO5, FlutterEchoUpToFourthOrder) {
  struct Row {
    double time_ms;
    int order;
    double amplitude;
  };
  const Row rows[] = {{4.956268222, 0, 0.04681027738},   {10.303555129, 1, 0.02206198238},  {11.531929836, 1, 0.01971195237},
                      {18.200827839, 2, 0.01223703232},  {22.756516766, 2, 0.009787267573}, {29.653685958, 3, 0.007359091140},
                      {30.980761178, 3, 0.007043861071}, {37.920649696, 4, 0.005638488675}, {42.557649324, 4, 0.005024129793}};
  const AcousticScene scene(two_planes(), flutter_config());
  std::vector<Arrival> arrivals;
  EarlyCandidates(scene, source()).find_arrivals(scene, listener(), arrivals);
  ASSERT_EQ(arrivals.size(), std::size(rows));
  for (std::size_t i = 0; i < arrivals.size(); ++i) {
    EXPECT_NEAR(1e3 * arrivals[i].distance_m / 343.0, rows[i].time_ms, 1e-5) << i;
    EXPECT_EQ(arrivals[i].order, rows[i].order) << i;
    EXPECT_NEAR(arrivals[i].amplitude[0], rows[i].amplitude, 1e-6 * rows[i].amplitude) << i;
  }
}

/// Energy of all images of order 5 and more that arrive in [from, to): x_n = n d + (n even: s, else d - s), amplitude 0.96^(n/2) / (4 pi
/// r).
double late_images(double from_s, double to_s) {
  double sum = 0;
  for (int n = -400; n <= 400; ++n) {
    if (std::abs(n) < 5) continue;
    const double x = n * kGapM + (n % 2 == 0 ? 1.2 : kGapM - 1.2) - 2.0, r = std::hypot(x, 1.5);
    if (r / 343 >= from_s && r / 343 < to_s) sum += std::pow(1 - kAbsorption, std::abs(n)) * decay::direct_energy(r);
  }
  return sum;
}

TEST(OracleO5, HigherOrdersComeThroughTheSourceVolume) {
  // Averaging 1 / r^2 over a ball of 1 m changes it by R^2 / (5 r^2): 0.07 % at 17 m, less beyond; it spreads an image over +-3 ms, so
  // windows end between images.
  AcousticConfig config = flutter_config();
  config.rays = 100'000;
  config.source_radius_m = 1.0f;
  const double window_s[][2] = {{0.045, 0.0755}, {0.0755, 0.1555}, {0.1555, 0.4755}};
  std::vector<double> traced[3];
  for (int seed = 1; seed <= 8; ++seed) {
    config.seed = static_cast<std::uint64_t>(seed);
    const EnergyHistogram h = rooms::late_field(two_planes(), config, source(), listener());
    for (int w = 0; w < 3; ++w) {
      double sum = 0;
      for (int i = 0; i < h.num_bins(); ++i) {
        if ((i + 0.5) * h.bin_s() >= window_s[w][0] && (i + 0.5) * h.bin_s() < window_s[w][1]) sum += h.energy(i, 0);
      }
      traced[w].push_back(sum);
    }
    // Orders up to four are the image paths' and must not count twice.
    double before = 0;
    for (int i = 0; i < 45; ++i) before += h.energy(i, 0);
    EXPECT_LT(before, 0.01 * late_images(0, 1));
  }
  for (int w = 0; w < 3; ++w) {
    const decay::Estimate late = decay::estimate(traced[w]);
    const double exact = late_images(window_s[w][0], window_s[w][1]);
    std::printf("flutter echo %.1f to %.1f ms: images %.5g, traced %.5g +- %.1g (%.2f sigma)\n", 1e3 * window_s[w][0], 1e3 * window_s[w][1],
                exact, late.mean, late.standard_error, (late.mean - exact) / late.standard_error);
    EXPECT_NEAR(late.mean, exact, 3.5 * late.standard_error + 1e-3 * exact) << w;
    EXPECT_LT(late.standard_error, 0.04 * exact) << w;  // a factor 1 - a per bounce in place of its root would show
  }
}

// A room of 6 x 5 x 3 m whose end walls absorb 2 % and all others 90 %, mirrors only: its decay is that of the flutter between the end
// walls.
std::shared_ptr<const Scene> flutter_room() {
  std::array<Material, 6> walls = rooms::uniform_walls(0.9, 0);
  walls[0] = walls[1] = rooms::uniform_walls(0.02, 0)[0];
  return rooms::box(6, 5, 3, walls);
}

/// Decay times of all images of that room, by the lines of this folder.
std::array<double, 2> decay_of_images(double bin_s, double length_s) {
  const double size[3] = {6, 5, 3}, s[3] = {1.7, 2.0, 1.4}, l[3] = {4.1, 2.9, 1.6}, kept[3] = {0.98, 0.1, 0.1};
  std::vector<double> series(static_cast<std::size_t>(length_s / bin_s), 0.0);
  const auto offset = [&](int axis, int n) { return n * size[axis] + (n % 2 == 0 ? s[axis] : size[axis] - s[axis]) - l[axis]; };
  const int reach = static_cast<int>(length_s * 343 / 6) + 2;
  const double direct_s = std::hypot(offset(0, 0), offset(1, 0), offset(2, 0)) / 343;
  for (int x = -reach; x <= reach; ++x)
    for (int y = -8; y <= 8; ++y)
      for (int z = -8; z <= 8; ++z) {
        const double r = std::hypot(offset(0, x), offset(1, y), offset(2, z));
        const auto bin = static_cast<std::size_t>((r / 343 - direct_s) / bin_s + 1e-6);
        if (bin >= series.size()) continue;
        series[bin] +=
            std::pow(kept[0], std::abs(x)) * std::pow(kept[1], std::abs(y)) * std::pow(kept[2], std::abs(z)) * decay::direct_energy(r);
      }
  return {decay::time_s(series, bin_s, -5, -25), decay::time_s(series, bin_s, -5, -35)};
}

TEST(OracleO5, FlutterRoomDecaysAsItsImages) {
  const auto of_images = decay_of_images(1e-3, 4);
  const double t20_s = of_images[0], t30_s = of_images[1];
  EXPECT_NEAR(t20_s, 1.79, 0.01);
  EXPECT_NEAR(t30_s, 3.35, 0.02);
  const glm::vec3 from = rooms::point(1.7, 2.0, 1.4), to = rooms::point(4.1, 2.9, 1.6);
  const auto room = flutter_room();
  const auto check = [&](const AcousticConfig& config, bool with_field, double tolerance) {
    const AcousticScene scene(room, config);
    const EarlyCandidates candidates(scene, from);
    const auto field = with_field ? build_source_field(scene, candidates) : nullptr;
    EnergyResponse response;
    compute_energy_response(scene, candidates, field.get(), to, response);
    const BandMetrics band = measure(scene, response).bands[0];
    ASSERT_TRUE(band.t20_s && band.t30_s);
    const auto errors = late_errors(scene, response);
    const double error20 = errors.empty() ? 0 : *errors[0].t20_error_s, error30 = errors.empty() ? 0 : *errors[0].t30_error_s;
    std::printf("flutter room, %d + %d rays%s, seed %d: T20 %.3f +- %.3f s (images %.3f), T30 %.3f +- %.3f s (images %.3f)\n", config.rays,
                config.source_rays, with_field ? ", field" : "", static_cast<int>(config.seed), *band.t20_s, error20, t20_s, *band.t30_s,
                error30, t30_s);
    EXPECT_NEAR(*band.t20_s, t20_s, tolerance * t20_s);
    EXPECT_NEAR(*band.t30_s, t30_s, tolerance * t30_s);
    if (errors.empty()) return;
    // The lines of the two measures differ by their bins: a thousandth of the value.
    EXPECT_NEAR(*band.t20_s, t20_s, 3 * error20 + 1e-3 * t20_s);
    EXPECT_NEAR(*band.t30_s, t30_s, 3 * error30 + 1e-3 * t30_s);
  };
  for (const char* preset : {"fast", "balanced", "high"}) {
    AcousticConfig config = acoustic_preset(preset);
    config.air_absorption = Switch::off;
    config.bands = 1;
    config.rir_length_s = 4.f;
    config.threads = 1;
    const bool high = config.source_rays > 0;
    for (int seed = 1; seed <= 5; ++seed) {
      config.seed = static_cast<std::uint64_t>(seed);
      check(config, false, high ? 0.1 : 0.15);
    }
    if (!high) check(config, true, 0.15);
  }
}

}  // namespace
}  // namespace earshot
