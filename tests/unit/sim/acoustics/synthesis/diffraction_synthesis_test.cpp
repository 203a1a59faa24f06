// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <numbers>

#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "tests/support/acoustics/rooms.h"
#include "tests/support/acoustics/wedge_cases.h"

namespace earshot {
namespace {

constexpr double kPi = std::numbers::pi;

/// RIR of the thin screen D1 of docs/evidence/oracles.md, O-24: 4 m straight, 4.472 m over the edge.
Rir render_screen(const AcousticConfig& config) {
  TriangleMesh mesh;
  rooms::append_quad(mesh, {glm::vec3(0, -200, 0), glm::vec3(200, -200, 0), glm::vec3(200, 200, 0), glm::vec3(0, 200, 0)}, 0);
  const AcousticScene scene(rooms::scene_of(std::move(mesh), {Material::uniform("hard", 0.f, 0.f)}), config);
  EnergyResponse response;
  compute_energy_response(scene, EarlyCandidates(scene, glm::vec3(1, 0, -2)), glm::vec3(1, 0, 2), response);
  RirSynthesizer synthesizer(make_synthesis_tables(config, scene.bands(), ChannelLayout::mono, nullptr));
  Rir rir;
  synthesizer.render(response, 0.0, 1, rir);
  return rir;
}

AcousticConfig screen_config() {
  AcousticConfig config;
  config.diffraction = Switch::on;
  config.air_absorption = Switch::off;
  config.rays = 0;
  config.rir_length_s = 0.1f;
  config.sample_rate_hz = 48000.f;
  return config;
}

TEST(O24Diffraction, RenderedScreenHasTheLossOfTheOctaves) {
  const Rir rir = render_screen(screen_config());
  const wedges::WedgeCase& screen = wedges::kCases[0];
  const double direct = 1.0 / (4 * kPi * 4);
  for (std::size_t i = 1; i < wedges::kFrequencyHz.size(); ++i) {
    // Mean of |H|^2 over the octave, by its definition: 64 frequencies.
    double sum = 0;
    for (int m = 0; m < 64; ++m) {
      const double frequency = wedges::kFrequencyHz[i] * std::sqrt(0.5) * (1 + (m + 0.5) / 64);
      const std::complex<double> turn = std::polar(1.0, -2 * kPi * frequency / 48000);
      std::complex<double> value = 0, phase = 1;
      for (const float sample : rir.channel(0)) {
        value += double{sample} * phase;
        phase *= turn;
      }
      sum += std::norm(value) / 64;
    }
    // One amplitude per octave with crossovers half an octave wide; the table's own octave means are 0.09 dB from its midbands.
    EXPECT_NEAR(-10 * std::log10(sum / (direct * direct)), screen.exact_octave_db[i], 0.5) << wedges::kFrequencyHz[i];
  }
}

TEST(O24Diffraction, RenderedScreenSoundsAfterItsArrival) {
  const Rir rir = render_screen(screen_config());
  // 1 / sqrt(j w) is causal; with its phase left out it would be even about the arrival: as much before as after.
  const double arrival = 4.472136 / 343 * 48000;
  double before = 0, after = 0;
  for (int n = 0; n < rir.num_samples; ++n) {
    const double sample = rir.samples[static_cast<std::size_t>(n)];
    if (n < arrival - 3) before += sample * sample;
    if (n > arrival + 3) after += sample * sample;
  }
  EXPECT_GT(after, 0);
  EXPECT_LT(before, 0.1 * after);
}

}  // namespace
}  // namespace earshot
