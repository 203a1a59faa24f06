// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/metrics/standard_errors.h"

#include <gtest/gtest.h>

#include "sim/acoustics/synthesis/carriers.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "sim/audio/head/hrtf.h"
#include "sim/base/random.h"
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

}  // namespace
}  // namespace earshot
