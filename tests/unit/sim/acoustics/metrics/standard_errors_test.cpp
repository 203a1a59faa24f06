// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/metrics/standard_errors.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "sim/acoustics/synthesis/carriers.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "sim/audio/head/hrtf.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/image_sum.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

// The errors of IACC are those of the bands that IACC itself is given for.
TEST(StandardErrors, OfIaccAreThoseOfTheOctavesMeasured) {
  for (std::uint32_t number = 0; number < 10; ++number) {
    const RandomStream random(518, Purpose::test, number);
    AcousticConfig config = acoustic_preset("fast");
    config.rays = 64;
    config.low_octave = number % 2 == 0;
    config.rir_length_s = 0.2f;
    const AcousticScene scene(rooms::shoe1(0.3 + 0.3 * double{random.uniform(0)}, 0.4), config);
    const glm::vec3 source = rooms::point(1.0 + double{random.uniform(1)}, 1.5, 1.2), listener = rooms::shoe1_listener();
    const EarlyCandidates candidates(scene, source);
    RirSynthesizer synthesizer(
        make_synthesis_tables(config, scene.bands(), ListenerLayout(ChannelLayout::binaural), Hrtf::rigid_sphere(config.sample_rate_hz)));
    const RenderEars render_ears = [&](const EnergyResponse& response, std::uint64_t carriers, Rir& ears) {
      synthesizer.render(response, 0.5, {carriers, listener}, ears);
    };
    EnergyResponse response;
    compute_energy_response(scene, candidates, listener, response);
    ParameterRequest request;
    request.interaural = true;
    const MetricErrors errors = standard_errors(scene, candidates, nullptr, listener, response, request, render_ears);
    EXPECT_EQ(errors.ears.size(), static_cast<std::size_t>(scene.num_bands())) << config.low_octave;
    EXPECT_EQ(errors.ears.size(), errors.bands.size());
  }
}

// Eight rays between two hard walls are one draw too few for EDT: of some draws it is ten times that of 64 rays.  The error of 64 rays
// covers, and is not that of the draws: root mean squares over rooms, within a factor of 2.5 as in StandardErrorsSlow.
TEST(StandardErrors, OfEdtAreNotThoseOfAnEighthOfTheRays) {
  double stated2 = 0, made2 = 0;
  int covered = 0;
  const std::vector<image_sum::MirrorRoom> rooms = image_sum::mirror_rooms(10);
  for (const image_sum::MirrorRoom& room : rooms) {
    const double direct = 1 / std::pow(4 * std::numbers::pi * room.distance_m(), 2);
    const BandMetrics truth = measure_band(room.images(1e-3, 1), 1e-3, direct);
    AcousticConfig config = acoustic_preset("fast");
    config.seed = 2;
    config.air_absorption = Switch::off;
    config.bands = 1;
    config.rir_length_s = 1;
    const AcousticScene scene(room.scene(), config);
    const EarlyCandidates candidates(scene, room.place(room.source));
    EnergyResponse response;
    compute_energy_response(scene, candidates, room.place(room.listener), response);
    const BandMetrics found = measure(scene, response).bands[0];
    const BandMetrics error = standard_errors(scene, candidates, nullptr, room.place(room.listener), response).bands[0];
    ASSERT_TRUE(truth.edt_s && found.edt_s && error.edt_s);
    const double off = *found.edt_s - *truth.edt_s;
    covered += std::abs(off) <= 2 * *error.edt_s;
    made2 += off * off, stated2 += *error.edt_s * *error.edt_s;
  }
  EXPECT_GE(covered, 9);
  EXPECT_LT(std::sqrt(stated2), 2.5 * std::sqrt(made2));
  EXPECT_GT(std::sqrt(stated2), 0.4 * std::sqrt(made2));
}

}  // namespace
}  // namespace earshot
