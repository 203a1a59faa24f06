// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <vector>

#include "sim/acoustics/metrics/late_errors.h"
#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/source_field/source_field.h"
#include "sim/base/random.h"
#include "sim/scene/air_sample.h"
#include "sim/scene/scene.h"

/// The preset `fast` with a field against paths, where rooms meet.
namespace earshot {
namespace {

constexpr int kPlaces = 10;

std::vector<glm::vec3> places_of_heads(const Scene& scene, int count) {
  const AirSample air = sample_air(scene, 1);
  std::vector<glm::vec3> places;
  for (std::uint32_t draw = 0; static_cast<int>(places.size()) < count; ++draw) {
    const glm::vec3 place = air.points[RandomStream(1, Purpose::test, draw).below(static_cast<std::uint32_t>(air.points.size()), 0)];
    const Hit floor = scene.rays().intersect(place, {0, -1, 0});
    bool free = floor.valid() && floor.distance_m > 1.2f && floor.distance_m < 1.8f;
    for (int i = 0; free && i < 8; ++i) {
      const float angle = 0.785398f * static_cast<float>(i);
      free = !scene.rays().intersect(place, {std::cos(angle), 0, std::sin(angle)}, 0.25f).valid();
    }
    if (free) places.push_back(place);
  }
  return places;
}

/// 368,000 triangles, eight rooms, the source in one of them, listeners in all.  Paths know T20 within 1.8 % at each place and band, which
/// is part of the difference.  The stated error is a standard error: a place is covered where the mean of the bands is within two of it.
TEST(SourceFieldCoupled, FastKnowsItsErrorInAHouseOfEightRooms) {
  const auto scene = std::make_shared<const Scene>(load_scene("house:3,rooms=8,detail_m=0.12"));
  std::vector<glm::vec3> places = places_of_heads(*scene, kPlaces + 1);
  const glm::vec3 source = places.front();
  places.erase(places.begin());
  AcousticConfig config = acoustic_preset("fast");
  config.rir_length_s = 1.f;
  config.threads = 0;
  config.diffraction = Switch::off;
  config.field = Switch::on;
  const AcousticScene fast(scene, config);
  const EarlyCandidates candidates(fast, source);
  const auto field = build_source_field(fast, candidates);

  AcousticConfig paths = config;
  paths.field = Switch::off;
  paths.rays = 131'072;
  paths.source_rays = 65'536;
  paths.source_bounces = 60;
  paths.diffuse_last_segment = false;
  paths.sh_order = 0;
  const AcousticScene high(scene, paths);
  double error = 0, error_of_paths = 0, bias = 0;
  int covered = 0, bands = 0;
  for (int i = 0; i < kPlaces; ++i) {
    // Paths from the source of its own for each place.
    const AcousticScene seeded = high.with_rays(paths.rays, 1000 + static_cast<std::uint64_t>(i));
    EnergyResponse truth, response;
    compute_energy_response(seeded, candidates, places[static_cast<std::size_t>(i)], truth);
    compute_energy_response(fast, candidates, field.get(), places[static_cast<std::size_t>(i)], response);
    const RoomMetrics expected = measure(seeded, truth), metrics = measure(fast, response);
    const std::vector<BandErrors> errors = late_errors(seeded, truth);
    double of_place = 0;
    int of_place_bands = 0;
    for (std::size_t band = 0; band < expected.bands.size(); ++band) {
      if (!expected.bands[band].t20_s || !errors[band].t20_error_s) continue;
      const double value_s = *expected.bands[band].t20_s, difference = metrics.bands[band].t20_s.value_or(0.0) / value_s - 1;
      of_place += std::fabs(difference);
      bias += difference;
      error_of_paths += *errors[band].t20_error_s / value_s;
      ++of_place_bands;
    }
    ASSERT_GT(of_place_bands, 0);
    error += of_place / kPlaces / of_place_bands;
    bands += of_place_bands;
    covered += of_place / of_place_bands < 2 * field->t20_error() ? 1 : 0;
  }
  std::printf("%llu photons, stated %.2f %%; measured %.2f %%, %+.2f %% with its sign, of which paths %.2f %%; covered %d of %d\n",
              static_cast<unsigned long long>(field->photons()), 100 * field->t20_error(), 100 * error, 100 * bias / bands,
              100 * error_of_paths / bands, covered, kPlaces);
  EXPECT_LT(error_of_paths / bands, 0.025);
  EXPECT_LT(error, 0.0475);
  EXPECT_GE(covered, 9);
}

}  // namespace
}  // namespace earshot
