// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "sim/acoustics/core/bands.h"

namespace earshot {

class AcousticSurfaces;

/// Largest change from leaving an effect out: 0.1 dB in the energy of any band at every time down to -45 dB, and 1 % of RT60
/// (docs/explanation/effect_bounds.md, section 1: a tenth and a fifth of the just noticeable difference).  An automatic length does not
/// count as an effect: it keeps
/// RT60 by as much and the decay curve by 0.1 dB down to -35 dB, by 0.5 dB down to -45 dB, as a curve that ends bends down before its end.
inline constexpr double kEffectBudgetDb = 0.1, kEffectBudgetRt = 0.01;
/// The fraction of energy that changes a level by the budget, 10^0.01 - 1: -16.3 dB.
inline constexpr double kEffectBudgetFraction = 0.023293;

/// Basis of a decision.
enum class BoundKind : std::uint8_t {
  exact,         ///< nothing is left out: the same bits, or only zeros dropped
  bounded,       ///< an omitted effect stays within the budget, by a bound that the plan computes from the scene
  approximated,  ///< for speed, by more than the budget and at most the number that is stated; `on` computes it in full
  user_set       ///< by the config, without a bound
};

/// One line of the plan.
struct EffectDecision {
  std::string effect;    ///< key of the config
  std::string decision;  ///< "on", "off", or a value
  bool on = false;
  double change = 0;  ///< off: largest change of a response; on: approximate change without the effect.  NaN: not estimated
  std::string unit;   ///< of `change`
  BoundKind kind = BoundKind::exact;
  double saved_ms = 0;  ///< per pose on one core, by the cost model; 0 if on
  std::string why;
};

/// Effects to simulate in a scene.  A function of the scene and the config, without its seed and threads; of the number of
/// rays only whether they are 512 or more.
struct EffectPlan {
  std::vector<EffectDecision> decisions;
  // the settings that the engine reads
  std::array<bool, kMaxBands> air{};  ///< bands that air damps
  int image_order = 0;                ///< of early reflections
  bool late = true;
  bool diffraction = false;            ///< if false, no source searches for edges; DiffractionBudget limits the paths
  bool straight_transmission = false;  ///< along the line of sight, at poses where it is blocked
  bool traced_transmission = false;    ///< inside the tracers
  bool field = false;
  bool wall_power = false;  ///< WallPower, at both ends of late sound
  float rir_length_s = 0;
  float source_radius_m = 0;    ///< of the volume that catches specular paths
  double mean_free_path_m = 0;  ///< of walks through the air (effect_probe.h); 0 without surfaces
};

/// Decides from the surfaces alone.  A few milliseconds: 256 short walks (effect_probe.h).  Throws InputError if
/// field = on meets a config that no field can carry.
EffectPlan plan_effects(const AcousticSurfaces& surfaces);

const char* name_of(BoundKind kind);

}  // namespace earshot
