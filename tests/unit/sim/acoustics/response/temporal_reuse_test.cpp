// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/response/temporal_reuse.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "sim/scene/scene.h"

namespace earshot {
namespace {

AcousticConfig quick_config(std::uint64_t seed = 1) {
  AcousticConfig config;
  config.rays = 8;
  config.early_candidate_rays = 50;
  config.rir_length_s = 0.15f;
  config.bands = 2;
  config.diffraction = Switch::off;
  config.seed = seed;
  return config;
}

std::shared_ptr<const Scene> room(const std::string& id) { return std::make_shared<const Scene>(load_scene(id)); }

std::vector<float> values_of(const EnergyResponse& response) {
  const auto values = response.late.values();
  return {values.begin(), values.end()};
}

double total(const EnergyHistogram& late) {
  double sum = 0;
  for (int bin = 0; bin < late.num_bins(); ++bin)
    for (int band = 0; band < late.num_bands(); ++band) sum += late.energy(bin, band);
  return sum;
}

/// One frame: source and listener.
struct Frame {
  glm::vec3 source, listener;
};

std::vector<std::vector<float>> walk(TemporalReuse& reuse, const AcousticScene& scene, const std::vector<Frame>& frames) {
  std::vector<std::vector<float>> out;
  EnergyResponse response;
  for (const Frame& frame : frames) {
    reuse.compute(scene, EarlyCandidates(scene, frame.source), frame.listener, response);
    out.push_back(values_of(response));
  }
  return out;
}

constexpr glm::vec3 kSource{1.5f, 1.4f, 1.1f}, kListener{4.5f, 1.2f, 2.7f};

TEST(TemporalReuse, FirstFrameHasTheBitsOfASingleResponse) {
  const AcousticScene scene(room("shoebox:6x3x4@0.3"), quick_config());
  const EarlyCandidates candidates(scene, kSource);
  EnergyResponse single, first;
  compute_energy_response(scene, candidates, kListener, single);
  TemporalReuse reuse;
  reuse.compute(scene, candidates, kListener, first);
  EXPECT_EQ(values_of(first), values_of(single));
  EXPECT_EQ(reuse.weight(), 1.0);
  reuse.compute(scene, candidates, kListener, first);
  EXPECT_NE(values_of(first), values_of(single));
  EXPECT_EQ(first.arrivals.size(), single.arrivals.size());  // what is not late is that of the pose
  for (std::size_t i = 0; i < single.arrivals.size(); ++i) EXPECT_EQ(first.arrivals[i].amplitude, single.arrivals[i].amplitude);
  reuse.forget();
  reuse.compute(scene, candidates, kListener, first);
  EXPECT_EQ(values_of(first), values_of(single));
}

// Linear blending of independent frames: after many, the variance of every value is a / (2 - a) of a single frame's
// (docs/explanation/estimators.md, section 8).
TEST(TemporalReuse, AtRestTheErrorFallsAsTheWeightSays) {
  const auto scene = room("shoebox:6x3x4@0.3");
  constexpr int runs = 40, frames = 100;
  const double a = TemporalReuseConfig{}.least_weight, expected = a / (2 - a);
  std::vector<double> mean;
  std::vector<std::vector<float>> blended, singles;
  for (int run = 0; run < runs; ++run) {
    const AcousticScene acoustics(scene, quick_config(static_cast<std::uint64_t>(100 + run)));
    const EarlyCandidates candidates(acoustics, kSource);
    TemporalReuse reuse;
    EnergyResponse response;
    std::vector<float> before;
    for (int frame = 0; frame < frames; ++frame) {
      reuse.compute(acoustics, candidates, kListener, response);
      if (frame == 0) singles.push_back(values_of(response));
      if (frame == 30) {
        EXPECT_NEAR(reuse.weight(), a, 1e-7);
      }
    }
    blended.push_back(values_of(response));
    mean.resize(blended.back().size());
    for (std::size_t k = 0; k < mean.size(); ++k) mean[k] += blended.back()[k] / double{runs};
  }
  // Truth: the mean of the blended, whose variance is 1/runs of theirs; so their own spread is short by that fraction.
  std::vector<double> of_blended, of_single;
  for (int run = 0; run < runs; ++run) {
    double squares_blended = 0, squares_single = 0;
    for (std::size_t k = 0; k < mean.size(); ++k) {
      squares_blended += std::pow(blended[run][k] - mean[k], 2);
      squares_single += std::pow(singles[run][k] - mean[k], 2);
    }
    of_blended.push_back(squares_blended * runs / (runs - 1));
    of_single.push_back(squares_single);
  }
  double sum_blended = 0, sum_single = 0;
  for (int run = 0; run < runs; ++run) sum_blended += of_blended[run], sum_single += of_single[run];
  const double ratio = sum_blended / sum_single;
  double squares = 0;  // delta method for a ratio of means
  for (int run = 0; run < runs; ++run) squares += std::pow((of_blended[run] - ratio * of_single[run]) / (sum_single / runs), 2);
  const double standard_error = std::sqrt(squares) / runs;
  ASSERT_LT(standard_error, 0.25 * expected);  // would see a missing square, or a factor 2
  EXPECT_NEAR(ratio, expected, 3 * standard_error);
}

TEST(TemporalReuse, AJumpASightChangeAndAnotherSceneAreColdStarts) {
  const AcousticScene scene(room("house:2,rooms=2,area_m2=30"), quick_config());
  const auto& bounds = scene.scene().bounds();
  const auto at = [&](float x, float z) { return bounds.lower + (bounds.upper - bounds.lower) * glm::vec3(x, 0.5f, z); };
  const auto seen = [&](glm::vec3 from, glm::vec3 to) { return !scene.scene().rays().occluded(from, to); };
  // A row of points 5 cm apart along the house: one where the listener's sight goes on, and one where it ends.
  const glm::vec3 listener = at(0.2f, 0.3f), near_step(0.05f, 0, 0);
  std::optional<glm::vec3> visible, edge;
  for (float z = 0.2f; z < 0.8f; z += 0.05f)
    for (glm::vec3 point = at(0.05f, z); point.x < at(0.95f, z).x; point += near_step) {
      if (!seen(listener, point) || glm::distance(listener, point) < 0.5f) continue;
      (seen(listener, point + near_step) ? visible : edge) = point;
    }
  ASSERT_TRUE(visible && edge);

  const AcousticScene other(room("shoebox:6x3x4@0.3"), quick_config());
  struct Case {
    const char* name;
    const AcousticScene* scene;
    std::vector<Frame> before, after;
  };
  const Case cases[] = {
      {"jump of the source", &other, {{kSource, kListener}, {kSource, kListener}}, {{kSource + glm::vec3(0.6f, 0, 0), kListener}}},
      {"jump of the listener", &other, {{kSource, kListener}, {kSource, kListener}}, {{kSource, kListener - glm::vec3(0.6f, 0, 0)}}},
      {"out of sight", &scene, {{*edge, listener}, {*edge, listener}}, {{*edge + near_step, listener}}},
      {"into sight", &scene, {{*edge + near_step, listener}, {*edge + near_step, listener}}, {{*edge, listener}}},
  };
  for (const Case& test : cases) {
    TemporalReuse warm, cold;
    walk(warm, *test.scene, test.before);
    std::vector<Frame> after(3, test.after[0]);  // and the frames after it
    EXPECT_EQ(walk(warm, *test.scene, after), walk(cold, *test.scene, after)) << test.name;
  }
  TemporalReuse warm, cold;
  walk(warm, scene, {{*visible, listener}, {*visible, listener}});
  const std::vector<Frame> after(3, Frame{kSource, kListener});
  EXPECT_EQ(walk(warm, other, after), walk(cold, other, after));
  // A small step in sight is not a change of scene.
  walk(warm, scene, {{*visible, listener}, {*visible + near_step, listener}});
  EXPECT_LT(warm.weight(), 1);
}

// A source that walks away at 1 m/s with 0.1 s per frame, in a hard and in a soft room.  The truth is the mean of single frames of all
// runs.
TEST(TemporalReuse, SteadyDriftIsBiasedLessThanTheBound) {
  for (const char* id : {"shoebox:9x3x5@0.1", "shoebox:9x3x5@0.5"}) {
    const auto scene = room(id);
    constexpr int runs = 60, steps = 45;
    std::vector<double> blended, truth;
    for (int run = 0; run < runs; ++run) {
      const AcousticScene acoustics(scene, quick_config(static_cast<std::uint64_t>(500 + run)));
      TemporalReuse reuse;
      EnergyResponse response;
      double sum = 0, single = 0;
      for (int step = 0; step < steps; ++step) {
        const EarlyCandidates candidates(acoustics, glm::vec3(2.5f + 0.1f * static_cast<float>(step), 1.5f, 2.f));
        reuse.compute(acoustics, candidates, {1, 1.4f, 2.8f}, response);
        if (step >= steps - 15) {
          sum += total(response.late);
          compute_energy_response(acoustics, candidates, {1, 1.4f, 2.8f}, response);
          single += total(response.late);
        }
      }
      EXPECT_LT(reuse.weight(), 0.8) << "nothing is reused";
      blended.push_back(sum);
      truth.push_back(single);
    }
    double sum = 0, single = 0;
    for (int run = 0; run < runs; ++run) sum += blended[run], single += truth[run];
    const double ratio = sum / single;
    double squares = 0;
    for (int run = 0; run < runs; ++run) squares += std::pow((blended[run] - ratio * truth[run]) / (single / runs), 2);
    const double standard_error_db = 4.34 * std::sqrt(squares) / runs;
    ASSERT_LT(standard_error_db, 0.2);
    EXPECT_LT(std::fabs(10 * std::log10(ratio)), TemporalReuseConfig{}.max_bias_db + 2 * standard_error_db) << id;
    RecordProperty(std::string("bias_db_") + id, std::to_string(10 * std::log10(ratio)));
  }
}

TEST(TemporalReuse, RulesAreChecked) {
  EXPECT_THROW(TemporalReuse({.least_weight = 0.f}), InputError);
  EXPECT_THROW(TemporalReuse({.max_bias_db = 0.f}), InputError);
  EXPECT_THROW(TemporalReuse({.drift_db_per_m = -1.f}), InputError);
  EXPECT_THROW(TemporalReuse({.max_move_m = std::nanf("")}), InputError);
}

// What walls near a pose add is taken out of all levels that are compared, the first one too: the weights are those of a scene without it.
TEST(TemporalReuse, WallsNearThePoseAreNoNoise) {
  double rise_db = 0;
  for (int number = 0; number < 10; ++number) {
    const RandomStream random(516, Purpose::test, static_cast<std::uint32_t>(number));
    const glm::vec3 source(0.05f + 0.1f * random.uniform(0), 0.05f + 0.1f * random.uniform(1), 0.05f + 0.1f * random.uniform(2));
    std::vector<std::vector<double>> weights;
    std::vector<double> first;
    for (const Switch power : {Switch::off, Switch::on}) {
      AcousticConfig config = quick_config();
      config.wall_power = power;
      const AcousticScene scene(room("shoebox:6x3x4@0.1"), config);
      TemporalReuse reuse({.max_bias_db = 5.f, .drift_db_per_m = 2.f});  // the noise decides
      EnergyResponse response;
      std::vector<double>& of_scene = weights.emplace_back();
      for (int frame = 0; frame < 9; ++frame) {
        const glm::vec3 listener = kListener + 0.08f * static_cast<float>(frame) * glm::vec3(0.f, 0.f, -1.f);
        reuse.compute(scene, EarlyCandidates(scene, source), listener, response);
        if (frame == 0) first.push_back(total(response.late));
        of_scene.push_back(reuse.weight());
      }
    }
    rise_db += std::log10(first[1] / first[0]);
    for (std::size_t frame = 0; frame < weights[0].size(); ++frame)
      EXPECT_NEAR(weights[1][frame], weights[0][frame], 1e-3) << number << ", frame " << frame;
  }
  EXPECT_GT(rise_db, 1);  // 1 dB a place
}

}  // namespace
}  // namespace earshot
