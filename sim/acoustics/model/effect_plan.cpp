// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/effect_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "sim/acoustics/geometry/diffraction_edges.h"
#include "sim/acoustics/model/acoustic_surfaces.h"
#include "sim/acoustics/model/air_absorption.h"
#include "sim/acoustics/model/diffraction_budget.h"
#include "sim/acoustics/model/effect_probe.h"
#include "sim/acoustics/model/flutter_time.h"
#include "sim/acoustics/model/source_poses.h"
#include "sim/base/denormals.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kMargin = 1.2, kOpenMargin = 2.0, kClosedFraction = 0.98;
constexpr double kShortestRirS = 0.1, kShortestHorizonS = 1.5, kLongestRirS = 4.0, kLongestDelayS = 0.6;
/// Level below which flutter between facing mirrors may be cut: the error is 0.5 dB of a decay curve at -45 dB.
constexpr double kFlutterFallDb = 55;
/// Rays for 5 % error of T30, one diffuse room; they grow with the inverse cube of the fraction of the air that is visible from a point:
/// 10, 80, 640 and 1250 for fractions of 1, 1/2, 1/4 and 1/5, against 10 in a room, 100 to 1300 in two coupled ones and 900 to 2100 in an
/// apartment that were measured (docs/explanation/estimators.md, section 10).
constexpr double kRaysOfARoom = 10;
/// Radius of the source volume.  Its blur in time and level goes with radius over path length, its noise with 1 / radius^2 of rays per room
/// surface, so it grows with the room (docs/explanation/estimators.md, section 2).
constexpr float kPathsPerRadius = 12.f, kMinRadiusM = 0.25f, kLargestRadiusM = 2.f;
/// A field costs memory and blurs cells: it must be this much cheaper.
constexpr double kFieldGain = 2;
constexpr double kPhotonsOfAField = 1000, kProbesMs = 15, kBlendMs = 0.02;
constexpr double kWallPowerMs = 0.005;
/// From here on accuracy is worth more than time: diffraction is complete (DiffractionBudget) and walls are passed.
constexpr int kManyRays = 512;

double level_change_db(double added) { return 10.0 * std::log10(1.0 + added); }

const char* name_of(Switch s) { return s == Switch::off ? "off" : "on"; }

/// Change by a decision and the kind of its bound, as in EffectDecision.
struct EffectChange {
  double value;
  const char* unit;
  BoundKind kind;
};
constexpr EffectChange kUserSet{kNan, "", BoundKind::user_set};
constexpr EffectChange kUnchanged{0, "dB", BoundKind::exact};

/// Cost model of a scene with a source field and without one.
struct FieldCosts {
  double rays;                 ///< per pose without a field
  double tracer_ms, field_ms;  ///< for all poses of a source
};

/// One call per effect, in the order of the table; each fills its part of the plan.
class Planner {
 public:
  explicit Planner(const AcousticSurfaces& surfaces) : surfaces_(surfaces), config_(surfaces.config()) {
    for (int band = 0; band < surfaces.num_bands(); ++band)
      air_per_m_.push_back(air_absorption_energy_per_m(surfaces.scene().air(), surfaces.bands().centre_hz[static_cast<std::size_t>(band)]));
    const double horizon_s = config_.rir_length_s > 0
                                 ? std::clamp(kMargin * config_.rir_length_s, kShortestHorizonS, kMargin * kLongestRirS)
                                 : kMargin * kLongestRirS;
    probe_ = probe_effects(surfaces, air_per_m_, horizon_s);
    const std::vector<double> no_air(air_per_m_.size(), 0.0);
    flutter_s_ = flutter_times(surfaces, config_.air_absorption == Switch::off ? no_air : air_per_m_, kFlutterFallDb, horizon_s);
  }

  EffectPlan plan() {
    plan_.mean_free_path_m = probe_.mean_free_path_m;
    plan_.source_radius_m = config_.source_radius_m > 0.f
                                ? config_.source_radius_m
                                : std::clamp(static_cast<float>(probe_.mean_free_path_m) / kPathsPerRadius, kMinRadiusM, kLargestRadiusM);
    decide_length();
    add("direct", config_.direct != Switch::off, name_of(config_.direct),
        {kNan, "", config_.direct == Switch::automatic ? BoundKind::exact : BoundKind::user_set}, 0,
        config_.direct == Switch::automatic ? "always on where the line of sight is free" : "");
    decide_late();
    decide_early();
    decide_diffraction();
    decide_transmission();
    decide_air();
    decide_wall_power();
    decide_low_octave();
    return std::move(plan_);
  }

 private:
  void add(std::string effect, bool on, std::string decision, const EffectChange& change, double saved_ms, std::string why) {
    plan_.decisions.push_back({.effect = std::move(effect),
                               .decision = std::move(decision),
                               .on = on,
                               .change = change.value,
                               .unit = change.unit,
                               .kind = change.kind,
                               .saved_ms = on ? 0.0 : saved_ms,
                               .why = std::move(why)});
  }

  /// As many as 2^31 - 1 from the listener alone: not an int.
  [[nodiscard]] double all_rays() const { return double{1} * config_.rays + config_.source_rays; }
  [[nodiscard]] double segments_per_ray(double length_s) const {
    return probe_.segments_per_ray(length_s * surfaces_.speed_of_sound_m_per_s());
  }
  /// A segment is a ray and a shadow ray, and as much again for what is done at its end.  Milliseconds on one core.
  [[nodiscard]] double trace_ms(double rays, double length_s) const {
    return rays * segments_per_ray(length_s) * 3.0 * probe_.query_us * 1e-3;
  }
  [[nodiscard]] double late_ms() const { return trace_ms(all_rays(), plan_.rir_length_s); }

  void decide_length() {
    const bool dry = config_.air_absorption == Switch::off;
    const auto longest = [](const std::vector<double>& row) { return *std::max_element(row.begin(), row.end()); };
    const double diffuse_s = longest(dry ? probe_.decay_s : probe_.decay_with_air_s);
    const double flutter_s = longest(flutter_s_);  // in closed form: no margin
    const double longest_s = std::max(diffuse_s, flutter_s);
    const double delay_s = std::min(double{surfaces_.diagonal_m()} / surfaces_.speed_of_sound_m_per_s(), kLongestDelayS);
    // In the open walks die out before they have fallen so far.
    const double wanted_s = delay_s + std::max((probe_.hit_fraction < kClosedFraction ? kOpenMargin : kMargin) * diffuse_s, flutter_s);
    const double step_s = 0.01;
    const double needed_s = std::clamp(std::ceil(wanted_s / step_s) * step_s, kShortestRirS, kLongestRirS);
    const bool automatic = config_.rir_length_s == 0.f;
    plan_.rir_length_s = automatic ? static_cast<float>(needed_s) : config_.rir_length_s;
    const double ends_db = longest_s > 0 ? kProbedFallDb * plan_.rir_length_s / longest_s : 1e3;
    const std::string decay =
        longest_s > 0
            ? fmt::format("{} falls by {:.0f} dB within {:.2f} s",
                          flutter_s > diffuse_s ? "flutter echo between parallel walls" : "the slowest band", kProbedFallDb, longest_s)
            : "there are no reflections";
    // An exponential decay is cut off 60 dB down: that moves T30 by less than the 0.85 % of a cut at -45 dB
    // (docs/explanation/effect_bounds.md, section 1).
    if (automatic) {
      const bool capped = wanted_s > kLongestRirS;
      const double saved = trace_ms(all_rays(), kLongestRirS) - late_ms();
      add("rir_length_s", false, fmt::format("{:.2f} s", plan_.rir_length_s),
          {capped ? ends_db : 100 * kEffectBudgetRt, capped ? "dB of decay kept" : "% of T30",
           capped ? BoundKind::approximated : BoundKind::bounded},
          saved, fmt::format("{}, plus a delay of at most {:.2f} s, with a margin{}", decay, delay_s, capped ? "; cut at 4 s" : ""));
    } else {
      add("rir_length_s", true, fmt::format("{:.2f} s", plan_.rir_length_s), kUserSet, 0,
          fmt::format("{}; the automatic length is {:.2f} s{}", decay, needed_s,
                      ends_db < 35 ? fmt::format("; this length ends at -{:.0f} dB: T30 cannot be measured", ends_db) : ""));
    }
  }

  [[nodiscard]] bool anything_reflects() const {
    for (std::uint32_t slot = 0; slot < surfaces_.scene().materials().size(); ++slot)
      for (const float reflectance : surfaces_.reflectance(slot))
        if (reflectance > 0.f) return true;
    return false;
  }

  void decide_late() {
    const bool comes_back = !surfaces_.scene().mesh().triangles.empty() && (anything_reflects() || surfaces_.transmits());
    plan_.late = config_.late == Switch::on || (config_.late == Switch::automatic && comes_back);
    if (config_.late != Switch::automatic) {
      add("late", plan_.late, name_of(config_.late), kUserSet, late_ms(), "");
    } else if (!comes_back) {
      add("late", false, "off", kUnchanged, late_ms(), "no surface reflects or transmits sound");
    } else {
      // Its energy must stay 45 dB below the direct sound before the decay curve can do without it: nearer than this.
      double absorption = 0;
      for (const double a : probe_.absorption) absorption += a / static_cast<double>(probe_.absorption.size());
      const double bounces = segments_per_ray(plan_.rir_length_s);
      add("late", true, "on", {kNan, "dB", BoundKind::bounded}, 0,
          fmt::format("{:.0f} % of rays hit a surface, which absorbs {:.0f} %: late sound follows the direct sound at every pose{}",
                      100 * probe_.hit_fraction, 100 * absorption,
                      config_.max_bounces > 3.0 * bounces
                          ? ""
                          : fmt::format("; max_bounces may end rays too early: a ray has about {:.0f} bounces", bounces)));
    }
  }

  void decide_early() {
    const int order = config_.specular_exponent != 0.f ? 0 : config_.early_order;
    const double reflectance = surfaces_.largest_specular_reflectance();
    const bool matters = reflectance > kEffectBudgetFraction;
    if (config_.early == Switch::off || order == 0) {
      add("early", false, "off", kUserSet, early_ms(),
          config_.specular_exponent != 0.f ? "specular reflections are lobes (specular_exponent)" : "");
    } else if (config_.early == Switch::on || matters) {
      plan_.image_order = order;
      add("early", true, fmt::format("order {}", order),
          {level_change_db(reflectance), "dB", config_.early == Switch::on ? BoundKind::user_set : BoundKind::bounded}, 0,
          fmt::format("{} planes; the strongest specular reflection has {:.1f} % of the energy", surfaces_.planes().size(),
                      100 * reflectance));
    } else {
      add("early", false, "off", {level_change_db(reflectance), "dB", reflectance > 0 ? BoundKind::bounded : BoundKind::exact}, early_ms(),
          reflectance > 0 ? "specular reflections are more than 16.3 dB below the direct sound; rays include them"
                          : "there are no specular reflections");
    }
  }
  [[nodiscard]] double early_ms() const {
    // Sequences: all of few planes, else about as many as rays of the source meet; each is refused by arithmetic, some by rays.
    const double sequences = std::min(std::pow(static_cast<double>(surfaces_.planes().size()), config_.early_order), 2000.0);
    return sequences * 1e-4 + 20 * probe_.query_us * 1e-3;
  }

  void decide_diffraction() {
    if (config_.diffraction == Switch::off) {
      add("diffraction", false, "off", kUserSet, diffraction_ms(), "");
      return;
    }
    const DiffractionEdges* edges = surfaces_.diffraction_edges();
    const bool has_edges = edges != nullptr && edges->size() > 0;
    plan_.diffraction = has_edges && (config_.diffraction == Switch::on || edge_in_sight(surfaces_, probe_.points));
    if (!plan_.diffraction) {
      add("diffraction", false, "off", kUnchanged, diffraction_ms(), "no diffracting edge is visible from the air");
      return;
    }
    const DiffractionBudget budget(config_);
    if (budget.near_boundary_only) {
      // An image has half its pressure where its plane ends (panel_reflection.h); beyond, a wave goes on from that half.  The largest
      // panels in the air have theirs; of other planes it is the edges', and without it nothing goes on.  Beside a direct sound as strong
      // and later by d an octave has 1 + 1/4 + mean cos(k d) of its energy instead of 1: 20 log10(1.5) = 3.5 dB more in phase, and 3.8 dB
      // less where the mean is least (k d = 2.85).
      constexpr double least_mean_cosine = -0.8333;
      add("diffraction", true, "where blocked, or nearly", {-10.0 * std::log10(1.25 + least_mean_cosine), "dB", BoundKind::approximated}, 0,
          "in the line of sight only at shadow boundaries; reflections, but for those of the largest panels in the air, end at half "
          "their pressure without diffraction at their edges (with diffraction: on, or 512 rays)");
    } else {
      add("diffraction", true, "on", {6.0, "dB", config_.diffraction == Switch::on ? BoundKind::user_set : BoundKind::bounded}, 0,
          "6 dB at a shadow boundary, more behind it; in the line of sight only at shadow and reflection boundaries");
    }
  }
  [[nodiscard]] double diffraction_ms() const { return 0.5 * config_.rays * probe_.query_us * 1e-2; }

  void decide_transmission() {
    const bool off = config_.transmission == Switch::off;
    plan_.straight_transmission = !off && surfaces_.transmits();
    const double straight_ms = 2 * probe_.query_us * 1e-3;
    if (!surfaces_.transmits() || off) {
      add("transmission", false, "off", {off ? kNan : 0, off ? "" : "dB", off ? BoundKind::user_set : BoundKind::exact}, straight_ms,
          off ? "" : "no material transmits sound");
      decide_field(false, 0);
      return;
    }
    add("transmission", true, "where blocked", {kNan, "dB", config_.transmission == Switch::on ? BoundKind::user_set : BoundKind::exact}, 0,
        "along the straight line, which may be the first arrival; none where the line of sight is free");
    decide_field(config_.transmission == Switch::on, *std::max_element(probe_.wall_to_air.begin(), probe_.wall_to_air.end()));
  }

  /// The field, and with it late transmission, which is worth tracing where a field pays for it once.
  void decide_field(bool forced_transmission, double wall_to_air) {
    const std::string unfit = unfit_for_field();
    if (config_.field == Switch::on && !unfit.empty() && plan_.late)
      throw InputError("field = on", "is not possible: " + unfit, "use field = auto, or remove the other setting");
    const FieldCosts costs = field_costs();
    // Cells fill the bounds of a scene: in the open a listener may be outside of them.
    const bool cheaper = probe_.hit_fraction >= kClosedFraction && costs.tracer_ms > kFieldGain * costs.field_ms;
    plan_.field = unfit.empty() && (config_.field == Switch::on || (config_.field == Switch::automatic && cheaper));
    if (plan_.straight_transmission) decide_late_transmission(forced_transmission, wall_to_air);
    add_field(unfit, costs);
  }
  /// Why no field can carry the late sound; empty: it can.
  [[nodiscard]] std::string unfit_for_field() const {
    if (!plan_.late) return "late sound is off";
    if (config_.source_rays > 0 && config_.field != Switch::on) return "source_rays selects bidirectional tracing";
    if (config_.specular_exponent != 0.f) return "specular_exponent selects lobes";
    return "";
  }
  [[nodiscard]] FieldCosts field_costs() const {
    const double rays = std::min(kRaysOfARoom / std::pow(std::max(probe_.visible_fraction, 0.1), 3.0), 2000.0);
    // Rays that would run instead: the configured number, or the needed one if larger.
    const double tracer_ms = kPosesPerSource * trace_ms(std::max(rays, static_cast<double>(config_.rays)), plan_.rir_length_s);
    // Photons for 5 %: their error falls as 0.7 to 1.8 over the root of their number, from a room to a furnished house (measured).  Per
    // pose eight histories are blended.
    const double pass_ms =
        trace_ms(std::min(kPhotonsOfAField, static_cast<double>(std::max(config_.field_photons, 512))), plan_.rir_length_s) + kProbesMs;
    return {rays, tracer_ms, pass_ms + kPosesPerSource * kBlendMs};
  }
  void decide_late_transmission(bool forced, double wall_to_air) {
    const bool matters = wall_to_air > kEffectBudgetFraction;
    const double change_db = level_change_db(wall_to_air), traced_ms = 0.3 * late_ms();
    // Photons pass walls once for all poses, many rays are configured where accuracy counts; with few rays per pose walls would double
    // the time for less than their noise, unless they are the only way.
    const bool affordable = plan_.field || all_rays() >= kManyRays || std::isinf(wall_to_air);
    plan_.traced_transmission = plan_.late && (forced || (matters && affordable));
    if (forced) {
      add("transmission_late", true, "on", {change_db, "dB", BoundKind::user_set}, 0, "");
    } else if (plan_.traced_transmission) {
      add("transmission_late", true, "on", {change_db, "dB", BoundKind::bounded}, 0,
          std::isinf(wall_to_air) ? "sound reaches some rooms only through walls"
                                  : "largest contribution of walls relative to sound through the air");
    } else if (!matters) {
      add("transmission_late", false, "off", {change_db, "dB", BoundKind::bounded}, traced_ms,
          wall_to_air > 0 ? "sound through walls is negligible relative to sound through the air"
                          : "no transmitting wall has air behind it");
    } else {
      add("transmission_late", false, "off", {change_db, "dB", BoundKind::approximated}, traced_ms,
          "upper bound in one band of one room, below the noise of few rays (traced with on, 512 rays or a source field)");
    }
  }
  void add_field(const std::string& unfit, const FieldCosts& costs) {
    const bool on = plan_.field;
    const std::string why = fmt::format(
        "on average {:.0f} % of the air is visible from a point: about {:.0f} rays per pose for 5 % of T30, {:.0f} ms for {:.0f} poses, or "
        "{:.0f} ms with a field",
        100 * probe_.visible_fraction, costs.rays, costs.tracer_ms, kPosesPerSource, costs.field_ms);
    const double saved = std::abs(costs.tracer_ms - costs.field_ms) / kPosesPerSource;
    if (config_.field != Switch::automatic) {
      add("field", on, name_of(config_.field), kUserSet, 0, why);
    } else if (!unfit.empty()) {
      add("field", false, "off", kUnchanged, 0, unfit);
    } else {
      add("field", on, name_of(on ? Switch::on : Switch::off),
          {on ? 100.0 * config_.field_error : 0, on ? "% of T20" : "dB", on ? BoundKind::bounded : BoundKind::exact}, 0, why);
      plan_.decisions.back().saved_ms = std::max(saved, 0.0);
    }
  }
  void decide_air() {
    const double longest_m = double{plan_.rir_length_s} * surfaces_.speed_of_sound_m_per_s();
    const double speed = surfaces_.speed_of_sound_m_per_s();
    const int coefficients = (config_.sh_order + 1) * (config_.sh_order + 1);
    const double band_ms = double{plan_.rir_length_s} / config_.time_bin_s * coefficients * 1e-6;
    double largest_off_db = 0, largest_on_db = 0;
    int off = 0;
    int lowest_on = -1;
    for (int b = 0; b < surfaces_.num_bands(); ++b) {
      const auto band = static_cast<std::size_t>(b);
      const double loss_db = 10.0 / std::numbers::ln10 * air_per_m_[band] * longest_m;
      // 1/T = 1/T0 + m c / (6 ln 10) (docs/evidence/oracles.md, O-16).
      const double rt_change = air_per_m_[band] * speed / (6.0 * std::numbers::ln10) * probe_.decay_s[band] * 60.0 / kProbedFallDb;
      const bool matters = loss_db > kEffectBudgetDb || !(rt_change < kEffectBudgetRt);
      plan_.air[band] = config_.air_absorption == Switch::on || (config_.air_absorption == Switch::automatic && matters);
      if (plan_.air[band]) {
        lowest_on = lowest_on < 0 ? b : lowest_on;  // air takes more the higher the band
        largest_on_db = std::max(largest_on_db, loss_db);
      } else {
        ++off;
        largest_off_db = std::max(largest_off_db, loss_db);
      }
    }
    if (config_.air_absorption != Switch::automatic) {
      add("air_absorption", config_.air_absorption == Switch::on, name_of(config_.air_absorption),
          {std::max(largest_on_db, largest_off_db), "dB", BoundKind::user_set}, off * band_ms,
          fmt::format("on the longest path, {:.0f} m", longest_m));
    } else if (off == surfaces_.num_bands()) {
      add("air_absorption", false, "off", {largest_off_db, "dB", BoundKind::bounded}, off * band_ms,
          fmt::format("on the longest path, {:.0f} m, and less than 1 % of RT60", longest_m));
    } else {
      add("air_absorption", true, fmt::format("from {:.0f} Hz up", surfaces_.bands().centre_hz[static_cast<std::size_t>(lowest_on)]),
          {largest_on_db, "dB", BoundKind::bounded}, 0, fmt::format("on the longest path, {:.0f} m", longest_m));
      if (off > 0) {
        add("air_absorption_low", false, fmt::format("off in the lowest {}", off), {largest_off_db, "dB", BoundKind::bounded},
            off * band_ms, fmt::format("on the longest path, {:.0f} m, and less than 1 % of RT60", longest_m));
      }
    }
  }

  void decide_wall_power() {
    const double rise_db = 10.0 * std::log10(8.0);  // of a corner
    const bool reflects = !surfaces_.planes().empty() && surfaces_.largest_specular_reflectance() > 0.f;
    plan_.wall_power = plan_.late && reflects && config_.wall_power != Switch::off;
    if (config_.wall_power == Switch::off) {
      add("wall_power", false, "off", kUserSet, kWallPowerMs, "");
    } else if (!plan_.wall_power) {
      add("wall_power", false, "off", kUnchanged, kWallPowerMs, plan_.late ? "no surface reflects as a mirror" : "there is no late sound");
    } else if (config_.wall_power == Switch::on) {
      add("wall_power", true, "on", {rise_db, "dB", BoundKind::user_set}, 0, "late sound, at a source or a listener in a rigid corner");
    } else {
      // No bound: sharper edges have more (wall_power.h).
      add("wall_power", true, "near walls", {rise_db, "dB", BoundKind::approximated}, 0,
          fmt::format(
              "late sound, at a source or a listener in a rigid corner of right angles; walls further off than {:.1f} m play no part",
              surfaces_.speed_of_sound_m_per_s() / surfaces_.bands().centre_hz.front()));
    }
  }

  /// A line only where there is something to decide: no built-in material has a value of its own at 63 Hz.
  void decide_low_octave() {
    if (config_.bands > 0) return;
    if (config_.low_octave) return add("low_octave", true, name_of(Switch::on), kUserSet, 0, "");
    const BandLayout low = BandLayout::octaves(config_.sample_rate_hz, true);
    double change_db = 0;
    for (std::uint32_t slot = 0; slot < surfaces_.scene().materials().size(); ++slot) {
      const double at_63 = 1.0 - double{surfaces_.scene().materials()[slot].absorption.band_mean(low.edge_hz[0], low.edge_hz[1])};
      const double at_125 = double{surfaces_.reflectance(slot)[0]};
      change_db = std::max(change_db, std::abs(10.0 * std::log10(std::max(at_63, 1e-6) / std::max(at_125, 1e-6))));
    }
    if (change_db > kEffectBudgetDb)
      add("low_octave", false, name_of(Switch::off), {change_db, "dB", BoundKind::approximated}, 0,
          "per reflection: a material has another absorption at 63 Hz than at 125 Hz, which counts with on");
  }

  const AcousticSurfaces& surfaces_;
  const AcousticConfig& config_;
  std::vector<double> air_per_m_, flutter_s_;
  EffectProbe probe_;
  EffectPlan plan_;
};

}  // namespace

EffectPlan plan_effects(const AcousticSurfaces& surfaces) {
  const FlushDenormals flush;
  return Planner(surfaces).plan();
}

const char* name_of(BoundKind kind) {
  constexpr std::array<const char*, 4> names = {"exact", "bounded", "approximated", "user_set"};
  return names[static_cast<std::size_t>(kind)];
}

}  // namespace earshot
