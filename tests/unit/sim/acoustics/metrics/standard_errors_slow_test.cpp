// SPDX-License-Identifier: Apache-2.0
// Coverage of the standard errors of parameters on request, over seeds.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <vector>

#include "sim/acoustics/metrics/band_metric_keys.h"
#include "sim/acoustics/metrics/standard_errors.h"
#include "sim/acoustics/synthesis/carriers.h"
#include "sim/audio/head/hrtf.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

/// Values of one parameter over seeds with their errors, each band apart.
struct Coverage {
  std::vector<std::vector<double>> values, errors;  ///< [band][seed]

  void add(std::size_t band, const std::optional<double>& value, const std::optional<double>& error) {
    if (values.size() <= band) values.resize(band + 1), errors.resize(band + 1);
    if (!value || !error) return;
    values[band].push_back(*value);
    errors[band].push_back(*error);
  }
  void expect(const char* name) const {
    int covered = 0, count = 0;
    double squares = 0, stated = 0;
    for (std::size_t band = 0; band < values.size(); ++band) {
      double mean = 0;
      const auto n = static_cast<double>(values[band].size());
      for (const double value : values[band]) mean += value / n;
      for (std::size_t i = 0; i < values[band].size(); ++i) {
        const double off = values[band][i] - mean;
        covered += std::abs(off) <= 2 * errors[band][i];
        ++count;
        squares += off * off * n / (n - 1);
        stated += errors[band][i] * errors[band][i];
      }
    }
    ASSERT_GT(count, 0) << name;
    const double ratio = std::sqrt(squares / stated);
    std::printf("%-12s %d of %d values within twice the error, spread over error %.2f\n", name, covered, count, ratio);
    EXPECT_GE(covered, 0.9 * count) << name;  // 95 % expected; 224 independent values tell it to 1.5 points
    // Student's factor for eight repetitions is 1.2: the spread is 0.83 of the stated error where all is right.
    // 32 values tell it to 13 %; an error that is off by 1.6 gives 0.52 or 1.33.
    EXPECT_GT(ratio, 0.6) << name;
    EXPECT_LT(ratio, 1.2) << name;
  }
};

TEST(StandardErrorsSlow, CoverTheSpreadOverSeeds) {
  constexpr int kSeeds = 32;
  const auto room = rooms::box(9, 7, 4, rooms::uniform_walls(0.2, 0.4));
  const glm::vec3 source = rooms::point(2, 2.3, 1.5), far = rooms::point(6.5, 4.4, 1.6), near = rooms::point(2.9, 2.735, 1.5);
  AcousticConfig config = acoustic_preset("balanced");
  config.rays = 512;
  config.sh_order = 4;
  config.rir_length_s = 1.3f;
  Coverage j_lf, j_lfc, lg, early, late, mti, sti, iacc_early, iacc_late;
  ParameterRequest request;
  request.lateral = request.speech = request.interaural = true;
  request.lateral_axis = lateral_axis(source, far);
  ParameterRequest stage;
  stage.stage = true;
  for (int seed = 1; seed <= kSeeds; ++seed) {
    config.seed = static_cast<std::uint64_t>(seed);
    const AcousticScene scene(room, config);
    const EarlyCandidates candidates(scene, source);
    RirSynthesizer synthesizer(
        make_synthesis_tables(config, scene.bands(), ListenerLayout(ChannelLayout::binaural), Hrtf::rigid_sphere(config.sample_rate_hz)));
    const std::uint64_t key = carrier_key(scene.hash(), source);
    const RenderEars render_ears = [&](const EnergyResponse& response, std::uint64_t carriers, Rir& ears) {
      synthesizer.render(response, 0.5, {key ^ (carriers * kCarrierStep), far}, ears);
    };
    EnergyResponse response;
    compute_energy_response(scene, candidates, far, response);
    const RoomMetrics metrics = measure(scene, response, request);
    const MetricErrors errors = standard_errors(scene, candidates, nullptr, far, response, request, render_ears);
    Rir ears;
    render_ears(response, 0, ears);
    const RoomMetrics heard = measure(ears, metrics.first_arrival_s.value_or(0));
    for (std::size_t band = 0; band < metrics.bands.size(); ++band) {
      j_lf.add(band, metrics.bands[band].j_lf, errors.bands[band].j_lf);
      j_lfc.add(band, metrics.bands[band].j_lfc, errors.bands[band].j_lfc);
      lg.add(band, metrics.bands[band].lg_db, errors.bands[band].lg_db);
      mti.add(band, metrics.bands[band].mti, errors.bands[band].mti);
      iacc_early.add(band, heard.bands[band].iacc_early, errors.ears[band].iacc_early);
      iacc_late.add(band, heard.bands[band].iacc_late, errors.ears[band].iacc_late);
    }
    sti.add(0, metrics.sti, errors.sti);
    EnergyResponse beside;
    compute_energy_response(scene, candidates, near, beside);
    const RoomMetrics on_stage = measure(scene, beside, stage);
    const MetricErrors stage_errors = standard_errors(scene, candidates, nullptr, near, beside, stage);
    for (std::size_t band = 0; band < on_stage.bands.size(); ++band) {
      early.add(band, on_stage.bands[band].st_early_db, stage_errors.bands[band].st_early_db);
      late.add(band, on_stage.bands[band].st_late_db, stage_errors.bands[band].st_late_db);
    }
  }
  j_lf.expect("j_lf"), j_lfc.expect("j_lfc"), lg.expect("lg_db"), early.expect("st_early_db"), late.expect("st_late_db");
  mti.expect("mti"), sti.expect("sti"), iacc_early.expect("iacc_early"), iacc_late.expect("iacc_late");
}

}  // namespace
}  // namespace earshot
