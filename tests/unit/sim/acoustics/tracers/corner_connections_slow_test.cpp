// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <numeric>
#include <vector>

#include "tests/support/acoustics/bidirectional_field.h"

// Paths that go from a mirror into a corner and back to a mirror: of theirs only the short edge inside the corner can be connected.
namespace earshot {
namespace {

/// 5 x 4 x 3 m of mirrors, but for a Lambert floor and a Lambert wall that meet in a corner.
std::shared_ptr<const Scene> room_with_rough_corner() {
  std::array<Material, 6> walls = rooms::uniform_walls(0.3, 0);
  walls[0] = walls[4] = rooms::uniform_walls(0.3, 1)[0];
  return rooms::box(5, 4, 3, walls);
}
glm::vec3 source() { return rooms::point(3.2, 1.5, 1.5); }
glm::vec3 listener() { return rooms::point(3.8, 2.6, 1.4); }

AcousticConfig corner_config() {
  AcousticConfig config = rooms::bidirectional_config(4096);
  config.source_radius_m = 1.f;
  config.source_bounces = 60;
  config.rir_length_s = 0.3f;
  return config;
}

struct Statistics {
  rooms::Sample total;
  double kurtosis = 0, largest = 0;  ///< largest: over the mean
};
/// Of the late energies over seeds.
template <class Energy>
Statistics over_seeds(Energy energy) {
  constexpr int kSeeds = 128;
  std::vector<double> values;
  for (int seed = 1; seed <= kSeeds; ++seed) {
    AcousticConfig config = corner_config();
    config.seed = static_cast<std::uint64_t>(seed);
    values.push_back(energy(config));
  }
  const double mean = std::accumulate(values.begin(), values.end(), 0.0) / kSeeds;
  double second = 0, fourth = 0, largest = 0;
  for (const double value : values) {
    second += std::pow(value - mean, 2) / kSeeds;
    fourth += std::pow(value - mean, 4) / kSeeds;
    largest = std::max(largest, value / mean);
  }
  return {{mean, std::sqrt(second / (kSeeds - 1))}, fourth / (second * second), largest};
}

TEST(CornerConnections, ShortEdgesAreLeftToTheVolume) {
  const auto room = room_with_rough_corner();
  const auto both_ends = [&](bool short_edges) {
    return over_seeds([&](const AcousticConfig& config) {
      return rooms::bidirectional_field(room, config, {source()}, listener(), {.short_edges = short_edges}).total().mean;
    });
  };
  // The tracer from the listener connects no two surfaces.
  const Statistics from_listener =
      over_seeds([&](const AcousticConfig& config) { return rooms::total_energy(rooms::late_field(room, config, source(), listener())); });
  const Statistics all = both_ends(true), open = both_ends(false);
  const auto print = [](const char* tracer, const Statistics& s) {
    std::printf("corner, %s: late energy %.5g +- %.1g, kurtosis over seeds %.1f, largest %.2f of the mean\n", tracer, s.total.mean,
                s.total.standard_error, s.kurtosis, s.largest);
  };
  print("from the listener", from_listener);
  print("all edges connected", all);
  print("short ones left to the volume", open);
  rooms::expect_same(open.total, from_listener.total, 3.5, 0.01);
  // Normal: 3, with a standard deviation of sqrt(24 / 128) = 0.43.
  EXPECT_GT(all.kurtosis, 10);
  EXPECT_LT(open.kurtosis, 5);
}

}  // namespace
}  // namespace earshot
