// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/wall_power.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/response/energy_response.h"
#include "tests/support/acoustics/edge_power.h"
#include "tests/support/acoustics/rooms.h"
#include "tests/support/draws.h"

namespace earshot {
namespace {

constexpr std::uint64_t kSeed = 38;  // of what is drawn

using rooms::point;

constexpr double kHalfTurn = std::numbers::pi;

double sinc(double x) { return std::abs(x) < 1e-6 ? 1.0 : std::sin(x) / x; }

/// Mean of f over the frequencies of a band, by the midpoints of `count` parts.
template <class F>
double band_mean(const BandLayout& bands, int band, int count, const F& f) {
  const double low = bands.edge_hz[static_cast<std::size_t>(band)], high = bands.edge_hz[static_cast<std::size_t>(band) + 1];
  double sum = 0;
  for (int i = 0; i < count; ++i) sum += f(2.0 * kHalfTurn * (low + (i + 0.5) / count * (high - low)) / rooms::kSpeedMPerS) / count;
  return sum;
}

TEST(WallPower, TheMeanOfABandIsThatOfManyFrequencies) {
  for (std::uint32_t number = 0; number < 20; ++number) {
    Draws draw(kSeed, number);
    const double low = draw.within(40, 4000), high = low * draw.within(1.05, 2.5), distance_m = std::pow(10.0, draw.within(-3, 1.3));
    double sum = 0;
    constexpr int parts = 20'000;
    for (int i = 0; i < parts; ++i)
      sum += sinc(2 * kHalfTurn / rooms::kSpeedMPerS * distance_m * (low + (i + 0.5) / parts * (high - low))) / parts;
    EXPECT_NEAR(band_mean_sinc(low, high, distance_m, rooms::kSpeedMPerS), sum, 1e-5) << low << ' ' << high << ' ' << distance_m;
  }
  EXPECT_NEAR(band_mean_sinc(88, 177, 0, 343), 1.0, 1e-9);
}

// Over an endless rigid floor: 1 + sin(2 k h) / (2 k h).  The table of a band is off by 2e-4, walls beyond a wavelength of 125 Hz are left
// out.
TEST(WallPower, OverARigidFloorItIsTheClosedForm) {
  const auto floor = rooms::half_space(0.0, 0.0);
  const AcousticScene scene(floor, wall_power_config());
  for (std::uint32_t number = 0; number < 12; ++number) {
    const double h = number == 0 ? 0.0 : std::pow(10.0, Draws(kSeed, number).within(-2.5, 0.4));
    const WallGain gain = scene.wall_gain(point(0.3, -0.2, h));
    for (int band = 0; band < scene.num_bands(); ++band)
      EXPECT_NEAR(gain.energy[static_cast<std::size_t>(band)],
                  band_mean(scene.bands(), band, 2000, [&](double k) { return 1.0 + sinc(2 * k * h); }), 1e-3)
          << h << " m, band " << band;
  }
}

/// Power that a point at distances h from one to three square walls sends into the air between them, over that without interference: the
/// mean over all directions of the square of the sum of pressures, by 60 x 120 directions.
double far_field_ratio(const std::vector<double>& h, const std::vector<double>& r, double k) {
  double together = 0, apart = 0;
  constexpr int rows = 60, columns = 120;
  for (int row = 0; row < rows; ++row) {
    const double z = (row + 0.5) / rows;
    for (int column = 0; column < columns; ++column) {
      const double azimuth = 0.5 * kHalfTurn * (column + 0.5) / columns;
      const std::array<double, 3> n{z, std::sqrt(1 - z * z) * std::cos(azimuth), std::sqrt(1 - z * z) * std::sin(azimuth)};
      std::complex<double> sum = 1;
      double energy = 1;
      for (std::size_t i = 0; i < h.size(); ++i) {
        sum *= 1.0 + r[i] * std::polar(1.0, 2 * k * h[i] * n[i]);
        energy *= 1 + r[i] * r[i];
      }
      together += std::norm(sum);
      apart += energy;
    }
  }
  return together / apart;
}

// Walls, edges and corners of absorbing walls, by the power of the far field, an octant of which is enough.  0.05 dB: the table, and the
// three walls opposite, 9 m off and more, which play no part.  A factor of 2 is 3 dB.
TEST(WallPower, WallsEdgesAndCornersSendThePowerOfTheirFarField) {
  for (std::uint32_t number = 0; number < 12; ++number) {
    Draws draw(kSeed, 100 + number);
    const std::size_t num_walls = 1 + number % 3;
    std::array<Material, 6> materials = rooms::uniform_walls(0.1, 0.0);
    std::vector<double> h, r;
    glm::dvec3 at(6, 5.5, 5);
    for (std::size_t i = 0; i < num_walls; ++i) {
      const double absorption = draw.within(0, 0.6);
      materials[2 * i] = Material::uniform("wall", static_cast<float>(absorption), 0.f);
      h.push_back(std::pow(10.0, draw.within(-2, 0.2)));
      r.push_back(std::sqrt(1 - static_cast<double>(static_cast<float>(absorption))));
      at[static_cast<int>(i)] = h.back();
    }
    const AcousticScene scene(rooms::box(12, 11, 10, materials), wall_power_config());
    const WallGain gain = scene.wall_gain(point(at.x, at.y, at.z));
    for (int band = 0; band < 4; ++band) {
      const double expected = band_mean(scene.bands(), band, 40, [&](double k) { return far_field_ratio(h, r, k); });
      EXPECT_NEAR(power_db(gain.energy[static_cast<std::size_t>(band)]), power_db(expected), 0.05) << number << ", band " << band;
    }
  }
}

/// Power of a source of a flat spectrum at a point in a rigid box, by the modes of a band, over that in the free field: as if the room had
/// the modes of its volume alone, 4 pi V f^2 / c^3 per hertz, and each the mean square at that point.  A mode at f takes power by 1 / f^2.
double modal_ratio(glm::dvec3 size, glm::dvec3 at, double low_hz, double high_hz) {
  double sum = 0;
  const auto most = [&](double length) { return static_cast<int>(2 * high_hz * length / rooms::kSpeedMPerS) + 1; };
  const auto square = [](int n, double x, double length) { return n == 0 ? 1.0 : 2.0 * std::pow(std::cos(n * kHalfTurn * x / length), 2); };
  for (int i = 0; i <= most(size.x); ++i)
    for (int j = 0; j <= most(size.y); ++j)
      for (int k = 0; k <= most(size.z); ++k) {
        const double hz = 0.5 * rooms::kSpeedMPerS * glm::length(glm::dvec3(i / size.x, j / size.y, k / size.z));
        if (hz < low_hz || hz >= high_hz) continue;
        sum += square(i, at.x, size.x) * square(j, at.y, size.y) * square(k, at.z, size.z) / (hz * hz);
      }
  const double of_volume = 4.0 * kHalfTurn * size.x * size.y * size.z * (high_hz - low_hz) / std::pow(rooms::kSpeedMPerS, 3);
  return sum / of_volume;
}

// The modes of one room scatter: their number and the walls opposite; so the power is the mean of 8 rooms of drawn sizes with the source
// at the same distances from its walls, which leaves 0.1 dB.  Tolerance 0.25 dB.
TEST(WallPower, InARigidRoomItIsThePowerIntoItsModes) {
  for (std::uint32_t number = 0; number < 12; ++number) {
    Draws draw(kSeed, 200 + number);
    std::vector<double> h;
    while (h.size() <= number % 3) h.push_back(number < 3 ? 0.03 : draw.within(0.02, 1.2));
    std::array<double, 2> modes{}, found{};
    constexpr std::uint32_t rooms_drawn = 8;
    for (std::uint32_t room = 0; room < rooms_drawn; ++room) {
      Draws of_room(kSeed, 10'000 + 100 * number + room);
      const glm::dvec3 size(of_room.within(13, 17), of_room.within(11, 13), of_room.within(9, 10.5));
      glm::dvec3 at = size * glm::dvec3(of_room.within(0.35, 0.65), of_room.within(0.35, 0.65), of_room.within(0.4, 0.6));
      for (std::size_t axis = 0; axis < h.size(); ++axis)
        at[static_cast<int>(axis)] = of_room.within(0, 1) < 0.5 ? h[axis] : size[static_cast<int>(axis)] - h[axis];
      const AcousticScene scene(rooms::box(size.x, size.y, size.z, rooms::uniform_walls(0, 0)), wall_power_config());
      const WallGain gain = scene.wall_gain(point(at.x, at.y, at.z));
      for (std::size_t band = 0; band < 2; ++band) {
        modes[band] += modal_ratio(size, at, scene.bands().edge_hz[band], scene.bands().edge_hz[band + 1]) / rooms_drawn;
        found[band] += gain.energy[band] / rooms_drawn;
      }
      if (number == 2) {
        EXPECT_NEAR(gain.energy[0], 8.0, 0.15);  // 3 cm from a corner
      }
    }
    for (std::size_t band = 0; band < 2; ++band)
      EXPECT_NEAR(power_db(found[band]), power_db(modes[band]), 0.25) << number << ", band " << band;
  }
}

/// Band mean of the square of the sum of the pressures of all images between 15 and 60 m from the listener, over the sum of their squares.
std::pair<double, double> image_energies(glm::dvec3 size, glm::dvec3 from, glm::dvec3 to, double r, double low_hz, double high_hz) {
  constexpr double first_m = 15, last_m = 60;
  constexpr int num_frequencies = 160;
  const double step = 2 * kHalfTurn / rooms::kSpeedMPerS * (high_hz - low_hz) / num_frequencies;
  std::array<std::complex<double>, num_frequencies> sum{};
  double apart = 0;
  const glm::ivec3 most(glm::ceil(last_m / (2.0 * size)));
  for (int x = -most.x; x <= most.x; ++x)
    for (int y = -most.y; y <= most.y; ++y)
      for (int z = -most.z; z <= most.z; ++z)
        for (int mirrored = 0; mirrored < 8; ++mirrored) {
          const glm::ivec3 m(mirrored & 1, mirrored >> 1 & 1, mirrored >> 2 & 1), n(x, y, z);
          const glm::dvec3 image = glm::dvec3(1 - 2 * m) * from + 2.0 * glm::dvec3(n) * size;
          const double distance_m = glm::length(image - to);
          if (distance_m < first_m || distance_m > last_m) continue;
          const glm::ivec3 order = glm::abs(2 * n - m);
          const double amplitude = std::pow(r, order.x + order.y + order.z) / distance_m;
          apart += amplitude * amplitude;
          std::complex<double> wave = std::polar(amplitude, -distance_m * (2 * kHalfTurn / rooms::kSpeedMPerS * low_hz + 0.5 * step));
          const std::complex<double> turn = std::polar(1.0, -distance_m * step);
          for (std::complex<double>& at : sum) {
            at += wave;
            wave *= turn;
          }
        }
  double together = 0;
  for (const std::complex<double>& at : sum) together += std::norm(at) / num_frequencies;
  return {together, apart};
}

// Both ends together, against the pressures of ten thousand images in boxes of real size: what energy tracers leave out is the product of
// the two factors.  The energy of a band at one pair of places scatters by 1 to 2 dB about its mean (few modes); of 12 pairs that leaves
// 0.5 dB: a tolerance of 1.2 dB for each kind of place, 0.6 dB for all.  The factors of the places are 0 to 9 dB.
TEST(WallPower, TheLateFieldOfImagePressuresHasTheFactorOfBothEnds) {
  double whole_together = 0, whole_expected = 0;
  for (int near = 0; near <= 3; ++near) {
    double together = 0, expected = 0;
    for (std::uint32_t number = 0; number < 40; ++number) {
      Draws draw(kSeed, 300 + 50 * static_cast<std::uint32_t>(near) + number);
      const glm::dvec3 size(draw.within(5, 8), draw.within(4, 6), draw.within(2.8, 4));
      glm::dvec3 from = size * glm::dvec3(draw.within(0.35, 0.65), draw.within(0.35, 0.65), draw.within(0.4, 0.6));
      for (int axis = 0; axis < near; ++axis) from[axis] = draw.within(0.02, 0.25);
      const glm::dvec3 to = size * glm::dvec3(draw.within(0.02, 0.98), draw.within(0.02, 0.98), draw.within(0.05, 0.95));
      const double absorption = draw.within(0.05, 0.3);
      const AcousticScene scene(rooms::box(size.x, size.y, size.z, rooms::uniform_walls(absorption, 0)), wall_power_config());
      const WallGain gain = scene.wall_gain(point(from.x, from.y, from.z)) * scene.wall_gain(point(to.x, to.y, to.z));
      const auto [with, without] =
          image_energies(size, from, to, std::sqrt(1 - absorption), scene.bands().edge_hz[1], scene.bands().edge_hz[2]);
      together += with / without;
      expected += gain.energy[1];
    }
    EXPECT_NEAR(power_db(together), power_db(expected), 1.2) << near << " walls";
    whole_together += power_db(together) / 4;
    whole_expected += power_db(expected) / 4;
  }
  EXPECT_NEAR(whole_together, whole_expected, 0.6);
}

TEST(WallPower, AnEdgeOfAnyAngleHasTheFreePartOfSpace) {
  // At the edge of a rigid wedge the power is 2 pi over its angle.
  for (std::uint32_t number = 0; number < 10; ++number) {
    const double angle = number == 0 ? kHalfTurn / 2 : Draws(kSeed, 400 + number).within(60, 160) / 180.0 * kHalfTurn;
    TriangleMesh mesh;
    const double x = 20 * std::cos(angle), z = 20 * std::sin(angle);
    rooms::append_quad(mesh, {point(0, -20, 0), point(20, -20, 0), point(20, 20, 0), point(0, 20, 0)}, 0);
    rooms::append_quad(mesh, {point(0, -20, 0), point(x, -20, z), point(x, 20, z), point(0, 20, 0)}, 0);
    const AcousticScene scene(rooms::scene_of(std::move(mesh), {Material::uniform("rigid", 0.f, 0.f)}), wall_power_config());
    const WallGain gain = scene.wall_gain(point(0.02 * std::cos(angle / 2), 0.1, 0.02 * std::sin(angle / 2)));
    EXPECT_NEAR(gain.energy[0], 2 * kHalfTurn / angle, 0.03 * 2 * kHalfTurn / angle) << angle;
  }
}

TEST(WallPower, APanelGrowsFromNothingToAWall) {
  double before = 1;
  for (const double edge_m : {0.05, 0.3, 1.0, 3.0, 12.0}) {
    TriangleMesh mesh;
    const double e = edge_m / 2;
    rooms::append_quad(mesh, {point(-e, -e, 0), point(e, -e, 0), point(e, e, 0), point(-e, e, 0)}, 0);
    const AcousticScene scene(rooms::scene_of(std::move(mesh), {Material::uniform("rigid", 0.f, 0.f)}), wall_power_config());
    const double gain = scene.wall_gain(point(0, 0, 0.02)).energy[0];
    EXPECT_GE(gain, before - 1e-6) << edge_m;
    before = gain;
    if (edge_m < 0.1) {
      EXPECT_NEAR(gain, 1.0, 0.01);
    }
  }
  EXPECT_NEAR(before, 2.0, 0.02);
}

TEST(WallPower, WallsBehindOthersPlayNoPart) {
  // A closet of 1.5 m in a hall: within it the hall's floor counts, its walls do not; outside the closet's walls count from outside.
  TriangleMesh mesh;
  rooms::append_box(mesh, {0, 0, 0}, {20, 20, 10}, 0);
  const AcousticScene hall(rooms::scene_of(mesh, {Material::uniform("rigid", 0.f, 0.f)}), wall_power_config());
  rooms::append_quad(mesh, {point(0.3, 0, 0), point(0.3, 20, 0), point(0.3, 20, 10), point(0.3, 0, 10)}, 0);
  const AcousticScene divided(rooms::scene_of(mesh, {Material::uniform("rigid", 0.f, 0.f)}), wall_power_config());
  const glm::vec3 at = point(0.5, 9, 5);
  EXPECT_NEAR(hall.wall_gain(at).energy[0], band_mean(hall.bands(), 0, 500, [](double k) { return 1 + sinc(k); }), 2e-3);
  EXPECT_NEAR(divided.wall_gain(at).energy[0], band_mean(hall.bands(), 0, 500, [](double k) { return 1 + sinc(0.4 * k); }), 2e-3);
}

EnergyResponse late_response(const AcousticScene& scene, glm::vec3 source, glm::vec3 listener) {
  EnergyResponse response;
  compute_energy_response(scene, EarlyCandidates(scene, source), listener, response);
  return response;
}

double late_energy(const EnergyResponse& response, int band) {
  double sum = 0;
  for (int bin = 0; bin < response.late.num_bins(); ++bin) sum += static_cast<double>(response.late.energy(bin, band));
  return sum;
}

// The same rays: the quotient is the factor, to rounding.
TEST(WallPower, LateSoundHasTheFactorOfBothEndsAndOfEitherDirection) {
  for (std::uint32_t number = 0; number < 10; ++number) {
    Draws draw(kSeed, 500 + number);
    const auto room = rooms::box(6, 5, 3, rooms::uniform_walls(draw.within(0.05, 0.5), draw.within(0, 0.6)));
    const glm::vec3 source = point(draw.within(0.02, 0.5), draw.within(0.02, 2), draw.within(0.02, 1)),
                    listener = point(draw.within(3, 5.9), draw.within(1, 4.9), draw.within(0.1, 2.9));
    AcousticConfig config;
    config.rir_length_s = 0.3f;
    config.rays = number % 2 == 0 ? 64 : 1024;
    config.source_rays = number % 2 == 0 ? 0 : 256;
    config.diffuse_last_segment = number % 2 == 0;
    const AcousticScene automatic(room, config);
    config.wall_power = Switch::off;
    const AcousticScene off(room, config);
    config.wall_power = Switch::on;
    const AcousticScene on(room, config);
    const EnergyResponse without = late_response(off, source, listener), with = late_response(on, source, listener),
                         by_default = late_response(automatic, source, listener), back = late_response(on, listener, source);
    const WallGain expected = on.wall_gain(source) * on.wall_gain(listener);
    EXPECT_FALSE(off.wall_gain(source).any);
    EXPECT_EQ(with.wall_gain.energy, expected.energy);
    EXPECT_EQ(with.wall_gain.energy, back.wall_gain.energy) << "reciprocity";
    for (int band = 0; band < on.num_bands(); ++band) {
      const double factor = expected.energy[static_cast<std::size_t>(band)];
      EXPECT_NEAR(late_energy(with, band) / late_energy(without, band), factor, 1e-4 * factor);
      EXPECT_NEAR(power_db(late_energy(by_default, band)), power_db(late_energy(with, band)), 0.2 + 1e-3);  // 0.1 dB at either end
    }
    EXPECT_EQ(with.arrivals.size(), without.arrivals.size());
  }
}

}  // namespace
}  // namespace earshot
