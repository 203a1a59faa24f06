// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "datasets/measured/measured_room.h"
#include "datasets/measured/octave_decay.h"
#include "sim/acoustics/core/acoustic_config.h"
#include "sim/scene/scene.h"

namespace earshot {

/// What is fitted, and how well it must agree.
struct MaterialFitConfig {
  std::vector<std::string> materials;  ///< names of materials of the scene; empty: all
  bool fit_scattering = true;          ///< beside absorption
  int starts = 24;                     ///< points of the global search
  int rounds = 20;                     ///< of Gauss-Newton steps from the best of them
  std::uint64_t seed = 1;
  double t20_error = 0.05;      ///< relative: the just noticeable difference of ISO 3382-1, table A.1
  double ratio_error_db = 1.0;  ///< of C50 and DRR: that of clarity in the same table
};

/// A coefficient in one octave, with the standard error that the spread of the data and the prior leave it.
struct FittedCoefficient {
  double value = 0, standard_error = 0;
};

/// By octave, in the order of FittedRoom::bands_hz.
struct FittedMaterial {
  std::string name;
  std::vector<FittedCoefficient> absorption, scattering;
};

struct FittedRoom {
  std::vector<double> bands_hz;  ///< octaves that the responses and the simulation have in common
  std::vector<FittedMaterial> materials;
  std::vector<double> misfit_before, misfit_after;  ///< [band] RMS of the differences in units of the errors above
  int simulations = 0;
};

/// Values of a response that a fit compares.
struct OctaveTarget {
  std::optional<double> t20_s, c50_db, drr_db;
};

/// Absorption and scattering of materials from responses at known places: the engine's own energy response is brought to agree with decay
/// time, clarity and direct-to-reverberant ratio of every place, octave by octave.  All octaves are searched at once, as the simulation
/// carries them together: a seeded global search (points of a Latin hypercube, the best for each octave), then damped Gauss-Newton steps
/// (Levenberg 1944, Marquardt 1963) with differences over common random numbers.  Coefficients are searched on a logit scale inside [0.01,
/// 0.99] with a wide prior about the scene's own values (Gaussian, 1.5 on that scale), so that what the responses do not determine stays
/// where it was, and its standard error says so.  scattering of a material without any mirror part is fitted like any other.
/// `chosen`: indices of the responses to fit to; empty: all.  Deterministic.  Cost: with P coefficients per octave starts + rounds (2 + P)
/// + 1 + P simulations of every place.  Throws InputError: a name that no material of the scene has, places that cannot be meant, no
/// response with a T20, locally reacting materials (their absorption follows from an impedance).
FittedRoom fit_materials(const std::shared_ptr<const Scene>& scene, const AcousticConfig& acoustics, const MeasuredRoom& room,
                         const MaterialFitConfig& config, std::span<const std::size_t> chosen = {},
                         const std::function<void(std::size_t done, std::size_t total)>& progress = {});

/// The scene with these coefficients: points at the octaves' centres, the ends held; transmission is lowered to the absorption.
std::shared_ptr<const Scene> with_materials(const Scene& scene, const FittedRoom& fitted);

/// A material file with every material of the fitted scene, fitted ones with their standard errors as source.
std::string material_file(const Scene& scene, const FittedRoom& fitted, const std::string& measured);

}  // namespace earshot
