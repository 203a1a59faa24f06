// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <span>
#include <vector>

#include "sim/acoustics/source_field/source_field.h"
#include "sim/acoustics/tracers/bidirectional_tracer.h"
#include "tests/support/acoustics/decay.h"
#include "tests/support/acoustics/rooms.h"

/// Fields of the preset `fast`, its cells and its error as they are, against paths in their decay, octave by octave, in two rooms of
/// different decay that a door joins.
namespace earshot::field_decay {

using rooms::point;

inline constexpr double kWallX = 4, kEndX = 9, kWidth = 4, kHeight = 2.7, kDoor0 = 1.6, kDoor1 = 2.5, kDoorHeight = 2.05;

/// A dead room of 4 x 4 x 2.7 m and a live one of 5 x 4 x 2.7 m, a thin wall with an open doorway of 0.9 x 2.05 m between them.  Alone they
/// would decay in 0.2 to 0.4 s and in about 1 s; the dead one is deader at high frequencies.
inline std::shared_ptr<const Scene> dead_and_live() {
  TriangleMesh mesh;
  const auto sheet = [&](int normal, double at, double u0, double u1, double v0, double v1, std::uint32_t material) {
    const auto corner = [&](double u, double v) { return normal == 0 ? point(at, u, v) : normal == 1 ? point(u, at, v) : point(u, v, at); };
    rooms::append_quad(mesh, {corner(u0, v0), corner(u1, v0), corner(u1, v1), corner(u0, v1)}, material);
  };
  sheet(0, 0, 0, kWidth, 0, kHeight, 0);
  sheet(0, kEndX, 0, kWidth, 0, kHeight, 1);
  for (const auto& [from, to, material] : {std::tuple{0.0, kWallX, 0u}, std::tuple{kWallX, kEndX, 1u}}) {
    sheet(1, 0, from, to, 0, kHeight, material);
    sheet(1, kWidth, from, to, 0, kHeight, material);
    sheet(2, 0, from, to, 0, kWidth, material);
    sheet(2, kHeight, from, to, 0, kWidth, material);
  }
  sheet(0, kWallX, 0, kDoor0, 0, kHeight, 1);
  sheet(0, kWallX, kDoor1, kWidth, 0, kHeight, 1);
  sheet(0, kWallX, kDoor0, kDoor1, kDoorHeight, kHeight, 1);
  Material dead = Material::uniform("dead", 0.2f, 0.5f);
  dead.absorption = {};
  for (const auto& [hz, value] : {std::pair{125.f, 0.2f}, std::pair{500.f, 0.3f}, std::pair{2000.f, 0.5f}, std::pair{8000.f, 0.6f}}) {
    dead.absorption.hz.push_back(hz);
    dead.absorption.value.push_back(value);
  }
  return rooms::scene_of(std::move(mesh), {dead, Material::uniform("live", 0.06f, 0.5f)}, Air{});
}

inline const glm::vec3 kInDead = point(1.2, 1.1, 1.5), kInLive = point(7.3, 2.9, 1.5);
/// In the dead room, on both sides of the doorway, in the live room; not in sight of the other room's source but through the door.
inline const std::vector<glm::vec3> kPlaces = {point(2.9, 3.2, 1.6), point(0.9, 2.9, 1.2), point(3.6, 2.0, 1.5),
                                               point(4.5, 2.2, 1.5), point(6.1, 0.9, 1.3), point(8.2, 1.6, 1.7)};

/// Late energy of one run at one place: [band][bin].
using Bands = std::vector<std::vector<double>>;

/// Runs of independent seeds at one place: their mean, and statistics of it with their standard errors.
struct Runs {
  std::vector<Bands> runs;

  [[nodiscard]] std::vector<double> mean(std::size_t band) const {
    std::vector<double> sum(runs[0][band].size(), 0.0);
    for (const Bands& run : runs)
      for (std::size_t i = 0; i < sum.size(); ++i) sum[i] += run[band][i] / static_cast<double>(runs.size());
    return sum;
  }
  /// A statistic of the mean of all runs, its standard error from the spread of single runs.
  template <class Statistic>
  [[nodiscard]] decay::Estimate of(std::size_t band, Statistic statistic) const {
    std::vector<double> values;
    for (const Bands& run : runs) values.push_back(statistic(run[band]));
    return {statistic(mean(band)), decay::estimate(values).standard_error};
  }
};

inline Bands bands_of(const EnergyHistogram& late, int num_bands) {
  Bands bands;
  for (int band = 0; band < num_bands; ++band) bands.push_back(late.band_energy(band));
  return bands;
}

struct Effort {
  int fields = 8;     ///< of independent seeds
  int path_runs = 8;  ///< of independent seeds at each place
  int path_rays = 0;  ///< from either end
  /// Standard errors of the difference, means over places and octaves: enough to tell.
  double most_t20_error = 0, most_curve_error_db = 0;
};

/// What a field may err.  In the mean over places and octaves: what `fast` promises of T20 (docs/explanation/acoustics.md) and half of what
/// is just heard of a level; its level at every place by what is just heard, 1 dB (docs/explanation/effect_bounds.md, section 1).
inline constexpr double kT20 = 0.0475, kCurveDb = 0.5, kLevelDb = 1.0;
struct DecayBounds {
  float cell_m;
  double t20, curve_db;  ///< of single octaves at single places, plus three standard errors
};
inline constexpr DecayBounds within_what_is_heard(float cell_m) { return {.cell_m = cell_m, .t20 = 0.10, .curve_db = kLevelDb}; }

struct Place {
  Runs field, paths;
};

/// Paths of independent seeds at every place.  `config`: that of the field.
inline void trace_paths(const std::shared_ptr<const Scene>& room, AcousticConfig config, glm::vec3 source, const Effort& effort,
                        std::vector<Place>& places) {
  config.field = Switch::off;
  config.rays = config.source_rays = effort.path_rays;
  config.source_bounces = 60;
  config.diffuse_last_segment = false;
  const AcousticScene scene(room, config);
  const EarlyCandidates candidates(scene, source);
  EnergyHistogram late = make_histogram(scene);
  for (std::size_t i = 0; i < places.size(); ++i) {
    for (int run = 0; run < effort.path_runs; ++run) {
      const AcousticScene seeded = scene.with_rays(effort.path_rays, 1000 * (i + 1) + static_cast<std::uint64_t>(run));
      trace_bidirectional(seeded, candidates, kPlaces[i], late);
      places[i].paths.runs.push_back(bands_of(late, scene.num_bands()));
    }
  }
}

/// Fields of independent seeds, gathered at every place.  Returns the error of T20 that each states.
inline std::vector<double> gather_fields(const std::shared_ptr<const Scene>& room, AcousticConfig config, glm::vec3 source, int fields,
                                         std::vector<Place>& places) {
  std::vector<double> stated;
  for (Place& place : places) place.field.runs.clear();
  for (int seed = 0; seed < fields; ++seed) {
    config.seed = static_cast<std::uint64_t>(seed);
    const AcousticScene scene(room, config);
    const EarlyCandidates candidates(scene, source);
    const auto field = build_source_field(scene, candidates);
    stated.push_back(field->t20_error());
    EnergyHistogram late = make_histogram(scene);
    for (std::size_t i = 0; i < places.size(); ++i) {
      field->gather(scene, kPlaces[i], late);
      places[i].field.runs.push_back(bands_of(late, scene.num_bands()));
    }
    if (seed + 1 == fields)
      std::printf("cells of %.1f m, %llu photons:\n", static_cast<double>(config.field_cell_m),
                  static_cast<unsigned long long>(field->photons()));
  }
  return stated;
}

/// Means over seeds show the bias of the field: T20 of each octave, and the decay curve every 5 dB down to -35 dB, at every place.  Each
/// field by itself shows what a user gets, and whether it states its error.
inline void expect_decay_of_paths(const std::vector<Place>& places, std::span<const double> stated, double bin_s, const Effort& effort,
                                  const DecayBounds& bounds) {
  const auto t20 = [&](const std::vector<double>& energy) { return decay::time_s(energy, bin_s, -5, -25); };
  const std::size_t num_bands = places[0].paths.runs[0].size();
  const double count = static_cast<double>(places.size() * num_bands);
  double t20_bias = 0, t20_size = 0, t20_worst = 0, t20_sigma_field = 0, t20_sigma_paths = 0, of_one_field = 0;
  double curve_size_db = 0, curve_worst_db = 0, curve_sigma_field_db = 0, curve_sigma_paths_db = 0, level_size_db = 0;
  int covered = 0, levels = 0;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const Runs &field = places[i].field, &paths = places[i].paths;
    std::vector<double> of_place(stated.size(), 0.0);
    double sigma_of_place = 0;
    for (std::size_t band = 0; band < num_bands; ++band) {
      const decay::Estimate truth_s = paths.of(band, t20), field_s = field.of(band, t20);
      const double difference = field_s.mean / truth_s.mean - 1;
      const double sigma_field = field_s.standard_error / truth_s.mean, sigma_paths = truth_s.standard_error / truth_s.mean;
      t20_bias += difference / count;
      t20_size += std::fabs(difference) / count;
      t20_worst = std::max(t20_worst, std::fabs(difference));
      t20_sigma_field += sigma_field / count;
      t20_sigma_paths += sigma_paths / count;
      sigma_of_place += sigma_paths / static_cast<double>(num_bands);
      EXPECT_LT(std::fabs(difference), bounds.t20 + 3 * std::hypot(sigma_field, sigma_paths))
          << "T20 at place " << i << ", band " << band << ": " << field_s.mean << " s, paths " << truth_s.mean << " s";
      for (std::size_t seed = 0; seed < stated.size(); ++seed) {
        const double error = std::fabs(t20(field.runs[seed][band]) / truth_s.mean - 1);
        of_place[seed] += error / static_cast<double>(num_bands);
        of_one_field += error / (count * static_cast<double>(stated.size()));
      }
      const auto total_db = [](const std::vector<double>& energy) { return 10 * std::log10(decay::curve(energy)[0]); };
      const double level_db = field.of(band, total_db).mean - paths.of(band, total_db).mean;
      level_size_db += std::fabs(level_db) / count;
      EXPECT_LT(std::fabs(level_db), kLevelDb) << "level at place " << i << ", band " << band;
      const std::vector<double> truth = decay::curve(paths.mean(band));
      for (double at_db = -5; at_db >= -35; at_db -= 5) {
        std::size_t bin = 0;
        while (bin + 1 < truth.size() && 10 * std::log10(truth[bin] / truth[0]) > at_db) ++bin;
        const auto at_bin = [&](const std::vector<double>& energy) {
          const std::vector<double> left = decay::curve(energy);
          return 10 * std::log10(left[bin] / left[0]);
        };
        const decay::Estimate truth_db = paths.of(band, at_bin), field_db = field.of(band, at_bin);
        const double size_db = std::fabs(field_db.mean - truth_db.mean);
        curve_size_db += size_db;
        curve_worst_db = std::max(curve_worst_db, size_db);
        curve_sigma_field_db += field_db.standard_error;
        curve_sigma_paths_db += truth_db.standard_error;
        ++levels;
        EXPECT_LT(size_db, bounds.curve_db + 3 * std::hypot(field_db.standard_error, truth_db.standard_error))
            << "decay curve at place " << i << ", band " << band << ", " << at_db << " dB: " << field_db.mean << " dB, paths "
            << truth_db.mean << " dB";
      }
    }
    for (std::size_t seed = 0; seed < stated.size(); ++seed)
      covered += of_place[seed] < 2 * std::hypot(stated[seed], sigma_of_place) ? 1 : 0;
  }
  curve_size_db /= levels, curve_sigma_field_db /= levels, curve_sigma_paths_db /= levels;
  const int pairs = static_cast<int>(places.size() * stated.size());
  std::printf(
      "    T20: field less paths %+.2f %%, size %.2f %%, worst %.1f %%; standard errors: field %.2f %%, paths %.2f %%\n"
      "    decay curve to -35 dB: size %.2f dB, worst %.2f dB; standard errors: field %.2f dB, paths %.2f dB; level: size %.2f dB\n"
      "    one field: T20 %.2f %%, stated %.2f %%, covered %d of %d\n",
      100 * t20_bias, 100 * t20_size, 100 * t20_worst, 100 * t20_sigma_field, 100 * t20_sigma_paths, curve_size_db, curve_worst_db,
      curve_sigma_field_db, curve_sigma_paths_db, level_size_db, 100 * of_one_field, 100 * decay::estimate(stated).mean, covered, pairs);
  EXPECT_LT(std::hypot(t20_sigma_field, t20_sigma_paths), effort.most_t20_error) << "too noisy to tell";
  EXPECT_LT(std::hypot(curve_sigma_field_db, curve_sigma_paths_db), effort.most_curve_error_db) << "too noisy to tell";
  EXPECT_LT(t20_size, kT20);
  EXPECT_LT(of_one_field, kT20);
  EXPECT_LT(curve_size_db, kCurveDb);
  EXPECT_GE(10 * covered, 9 * pairs);
}

/// The late field of `fast` but for its cells: the same paths judge each size of them.
inline void expect_decay_of_paths(glm::vec3 source, const Effort& effort, std::span<const DecayBounds> cells) {
  const std::shared_ptr<const Scene> room = dead_and_live();
  AcousticConfig config = acoustic_preset("fast");
  config.rir_length_s = 1.6f;
  config.diffraction = Switch::off;
  config.field = Switch::on;
  config.sh_order = 0;
  std::vector<Place> places(kPlaces.size());
  trace_paths(room, config, source, effort, places);
  for (const DecayBounds& bounds : cells) {
    config.field_cell_m = bounds.cell_m;
    const std::vector<double> stated = gather_fields(room, config, source, effort.fields, places);
    expect_decay_of_paths(places, stated, double{config.time_bin_s}, effort, bounds);
  }
}

}  // namespace earshot::field_decay
