#include <gtest/gtest.h>

#include <cstdio>

#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/response/energy_response.h"
#include "tests/support/decay.h"
#include "tests/support/late_field.h"

// docs/oracles.md, O-5: two parallel planes 3.43 m apart, open sides.
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

}  // namespace
}  // namespace earshot
