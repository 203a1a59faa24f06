// SPDX-License-Identifier: Apache-2.0
#include "datasets/measured/material_fit.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>
#include <set>

#include "datasets/measured/normal_equations.h"
#include "datasets/measured/room_comparison.h"
#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "sim/base/text/json.h"
#include "sim/base/text/text_match.h"

namespace earshot {
namespace {

constexpr double kLowest = 0.01, kHighest = 0.99;  ///< of coefficients
constexpr double kPriorSpread = 1.5, kSearchSpread = 2.0, kDifference = 0.8, kLargestStep = 1.5;
constexpr int kValuesPerPlace = 3;

/// Not at the ends, where the slope vanishes and a prior would not be wide.
double logit(double coefficient) {
  const double x = std::clamp((coefficient - kLowest) / (kHighest - kLowest), 0.05, 0.95);
  return std::log(x / (1 - x));
}
double coefficient_at(double u) { return kLowest + (kHighest - kLowest) / (1 + std::exp(-u)); }
/// Half of what the coefficient changes from u - spread to u + spread.
double error_at(double u, double spread) { return 0.5 * (coefficient_at(u + spread) - coefficient_at(u - spread)); }

/// Values of the search: [band][parameter], absorption of every material, then scattering.
using Point = std::vector<std::vector<double>>;
/// [band][place, value], in units of the errors; 0 where there is nothing to compare.
using Residuals = std::vector<std::vector<double>>;

double cost_of(const std::vector<double>& residuals, const std::vector<double>& u, const std::vector<double>& prior) {
  double cost = std::inner_product(residuals.begin(), residuals.end(), residuals.begin(), 0.0);
  for (std::size_t p = 0; p < u.size(); ++p) cost += std::pow((u[p] - prior[p]) / kPriorSpread, 2);
  return cost;
}

CoefficientCurve curve_of(const std::vector<double>& bands_hz, const std::vector<FittedCoefficient>& values) {
  CoefficientCurve curve;
  for (std::size_t b = 0; b < bands_hz.size(); ++b) {
    curve.hz.push_back(static_cast<float>(bands_hz[b]));
    curve.value.push_back(static_cast<float>(values[b].value));
  }
  return curve;
}

/// Materials of a scene by name, those that are fitted.
std::vector<Material> chosen_materials(const Scene& scene, const std::vector<std::string>& names) {
  std::vector<Material> distinct;
  std::set<std::string> known;
  for (const Material& material : scene.materials())
    if (known.insert(material.name).second) distinct.push_back(material);
  std::set<std::string> asked;
  for (const std::string& name : names) {
    if (!known.contains(name)) {
      const std::string nearest = nearest_word(name, known);
      throw InputError("material '" + name + "'", "is not in the scene",
                       nearest.empty() ? "use a name that 'earshot scene' prints" : "did you mean '" + nearest + "'?");
    }
    if (!asked.insert(name).second) throw InputError("material '" + name + "'", "is given twice", "give it once");
  }
  if (!names.empty()) std::erase_if(distinct, [&](const Material& material) { return !asked.contains(material.name); });
  for (const Material& material : distinct)
    if (material.locally_reacting)
      throw InputError("material '" + material.name + "'", "is locally reacting: its absorption follows from an impedance",
                       "name the materials to fit with --materials, or leave out its angle");
  return distinct;
}

class Fit {
 public:
  Fit(const std::shared_ptr<const Scene>& scene, const AcousticConfig& acoustics, const MeasuredRoom& room, const MaterialFitConfig& config,
      std::span<const std::size_t> chosen, const std::function<void(std::size_t done, std::size_t total)>& progress)
      : scene_(scene),
        acoustics_(acoustics),
        room_(room),
        config_(config),
        materials_(chosen_materials(*scene, config.materials)),
        progress_(progress) {
    const AcousticScene first(scene, acoustics);
    check_places(first, room);
    for (const float hz : first.bands().centre_hz)
      if (hz > kLowestComparedHz && hz < kHighestComparedHz) fitted_.bands_hz.push_back(hz);
    choose_places(chosen);
    for (const Material& material : materials_) fitted_.materials.push_back({.name = material.name, .absorption = {}, .scattering = {}});
    for (const double hz : fitted_.bands_hz) {
      std::vector<double>& prior = prior_.emplace_back();
      for (const Material& material : materials_) prior.push_back(logit(material.absorption.at(static_cast<float>(hz))));
      if (config.fit_scattering)
        for (const Material& material : materials_) prior.push_back(logit(material.scattering.at(static_cast<float>(hz))));
    }
    total_ = static_cast<std::size_t>(config.starts) + static_cast<std::size_t>(config.rounds) * (2 + parameters()) + 1 + parameters();
  }

  FittedRoom run() {
    Point best = search();
    std::vector<double> damping(bands(), 0.01);
    for (int round = 0; round < config_.rounds; ++round) improve(best, damping);
    finish(best);
    return fitted_;
  }

 private:
  [[nodiscard]] std::size_t bands() const { return fitted_.bands_hz.size(); }
  [[nodiscard]] std::size_t parameters() const { return prior_.front().size(); }

  void choose_places(std::span<const std::size_t> chosen) {
    std::vector<std::size_t> places(chosen.begin(), chosen.end());
    if (places.empty()) {
      places.resize(room_.responses.size());
      std::iota(places.begin(), places.end(), std::size_t{0});
    }
    bool has_decay = false;
    for (const std::size_t place : places) {
      const MeasuredResponse& measured = room_.responses[place];
      std::vector<OctaveTarget>& targets = targets_.emplace_back(bands());
      for (const OctaveDecay& decay : octave_decays(measured.samples, room_.sample_rate_hz, measured.direct_delay_s))
        for (std::size_t b = 0; b < bands(); ++b) {
          if (std::abs(decay.centre_hz / fitted_.bands_hz[b] - 1) > 0.01) continue;
          targets[b] = {decay.metrics.t20_s, decay.metrics.c50_db, decay.centre_hz < kLowestDrrHz ? std::nullopt : decay.metrics.drr_db};
          has_decay = has_decay || decay.metrics.t20_s;
        }
      SoundSource source(scene_->to_local(measured.source_m));
      source.directivity = room_.source_pattern, source.orientation = measured.source_orientation;
      sources_.push_back(source);
      listeners_.push_back(scene_->to_local(measured.listener_m));
    }
    if (!has_decay)
      throw InputError("the measured responses", "have no decay time between 250 Hz and 4 kHz",
                       "use records that fall by 25 dB above their noise");
  }

  [[nodiscard]] FittedRoom at(const Point& point) const {
    FittedRoom room{.bands_hz = fitted_.bands_hz, .materials = fitted_.materials, .misfit_before = {}, .misfit_after = {}};
    for (std::size_t m = 0; m < materials_.size(); ++m)
      for (std::size_t b = 0; b < bands(); ++b) {
        room.materials[m].absorption.push_back({.value = coefficient_at(point[b][m])});
        if (config_.fit_scattering) room.materials[m].scattering.push_back({.value = coefficient_at(point[b][materials_.size() + m])});
      }
    return room;
  }

  Residuals residuals_at(const Point& point) { return residuals_of(with_materials(*scene_, at(point))); }

  Residuals residuals_of(const std::shared_ptr<const Scene>& scene) {
    const AcousticScene acoustics(scene, acoustics_);
    Residuals residuals(bands());
    EnergyResponse response;
    for (std::size_t place = 0; place < sources_.size(); ++place) {
      const EarlyCandidates candidates(acoustics, sources_[place]);
      compute_energy_response(acoustics, candidates, listeners_[place], response);
      const RoomMetrics metrics = measure(acoustics, response);
      for (std::size_t b = 0; b < bands(); ++b) {
        const BandMetrics& simulated = metrics.bands[band_in(acoustics, b)];
        const OctaveTarget& target = targets_[place][b];
        const std::optional<double> ln_t20 = simulated.t20_s ? std::optional(std::log(*simulated.t20_s)) : std::nullopt;
        const std::optional<double> ln_target = target.t20_s ? std::optional(std::log(*target.t20_s)) : std::nullopt;
        residuals[b].push_back(residual(ln_t20, ln_target, config_.t20_error, std::log(2.0)));
        residuals[b].push_back(residual(simulated.c50_db, target.c50_db, config_.ratio_error_db, 10));
        residuals[b].push_back(residual(simulated.drr_db, target.drr_db, config_.ratio_error_db, 10));
      }
    }
    ++fitted_.simulations;
    if (progress_) progress_(static_cast<std::size_t>(fitted_.simulations), total_);
    return residuals;
  }

  [[nodiscard]] std::size_t band_in(const AcousticScene& acoustics, std::size_t band) const {
    const auto& centres = acoustics.bands().centre_hz;
    return static_cast<std::size_t>(std::ranges::find_if(centres, [&](float hz) { return double{hz} == fitted_.bands_hz[band]; }) -
                                    centres.begin());
  }

  /// A simulation without the value counts as far off: it must not look like agreement.
  [[nodiscard]] static double residual(const std::optional<double>& simulated, const std::optional<double>& target, double error,
                                       double far_off) {
    if (!target) return 0;
    return (simulated ? *simulated - *target : far_off) / error;
  }

  /// Number of values of a band that are compared.
  [[nodiscard]] double compared(std::size_t band) const {
    double count = 0;
    for (const std::vector<OctaveTarget>& place : targets_)
      for (const auto& value : {place[band].t20_s, place[band].c50_db, place[band].drr_db}) count += value ? 1 : 0;
    return count;
  }

  [[nodiscard]] double misfit(const std::vector<double>& residuals, std::size_t band) const {
    const double sum = std::inner_product(residuals.begin(), residuals.end(), residuals.begin(), 0.0);
    return std::sqrt(sum / std::max(1.0, compared(band)));
  }

  /// The best of the scene's own coefficients and the points of a Latin hypercube about them, octave by octave.
  Point search() {
    Point best = prior_;
    std::vector<double> cost(bands());
    for (int start = 0; start < config_.starts; ++start) {
      Point point = prior_;
      for (std::size_t p = 0; start > 0 && p < parameters(); ++p) {
        // A permutation of the starts for each parameter, the same in all octaves: a stratum each.
        const RandomStream random(config_.seed, Purpose::material, 41, static_cast<std::uint32_t>(p));
        std::vector<std::pair<float, int>> order;
        for (int i = 1; i < config_.starts; ++i) order.emplace_back(random.uniform(static_cast<std::uint32_t>(i)), i);
        std::ranges::sort(order);
        const auto rank = std::ranges::find_if(order, [&](const auto& entry) { return entry.second == start; }) - order.begin();
        const double stratum = (static_cast<double>(rank) + 0.5) / (config_.starts - 1);
        for (std::size_t b = 0; b < bands(); ++b) point[b][p] += kSearchSpread * (2 * stratum - 1);
      }
      const Residuals residuals = residuals_at(point);
      for (std::size_t b = 0; b < bands(); ++b) {
        if (start == 0) fitted_.misfit_before.push_back(misfit(residuals[b], b));
        const double here = cost_of(residuals[b], point[b], prior_[b]);
        if (start > 0 && here >= cost[b]) continue;
        cost[b] = here, best[b] = point[b];
      }
    }
    return best;
  }

  /// Derivatives [band][parameter][residual] at a point.
  std::vector<std::vector<std::vector<double>>> derivatives(const Point& point, const Residuals& here) {
    std::vector<std::vector<std::vector<double>>> slopes(bands(), std::vector<std::vector<double>>(parameters()));
    for (std::size_t p = 0; p < parameters(); ++p) {
      Point moved = point;
      for (std::size_t b = 0; b < bands(); ++b) moved[b][p] += point[b][p] > 0 ? -kDifference : kDifference;
      const Residuals there = residuals_at(moved);
      for (std::size_t b = 0; b < bands(); ++b)
        for (std::size_t i = 0; i < here[b].size(); ++i) slopes[b][p].push_back((there[b][i] - here[b][i]) / (moved[b][p] - point[b][p]));
    }
    return slopes;
  }

  [[nodiscard]] NormalEquations equations(const std::vector<std::vector<double>>& slopes, const std::vector<double>& residuals,
                                          const std::vector<double>& u, const std::vector<double>& prior) const {
    NormalEquations normal(parameters());
    std::vector<double> row(parameters());
    for (std::size_t i = 0; i < residuals.size(); ++i) {
      for (std::size_t p = 0; p < parameters(); ++p) row[p] = slopes[p][i];
      normal.add(row, residuals[i]);
    }
    for (std::size_t p = 0; p < parameters(); ++p) {
      std::ranges::fill(row, 0.0);
      row[p] = 1 / kPriorSpread;
      normal.add(row, (u[p] - prior[p]) / kPriorSpread);
    }
    return normal;
  }

  /// One damped step, kept in the octaves that it improves.
  void improve(Point& point, std::vector<double>& damping) {
    const Residuals here = residuals_at(point);
    const auto slopes = derivatives(point, here);
    Point moved = point;
    for (std::size_t b = 0; b < bands(); ++b) {
      NormalEquations normal = equations(slopes[b], here[b], point[b], prior_[b]);
      normal.damp(damping[b]);
      const auto step = normal.step();
      if (!step) continue;
      for (std::size_t p = 0; p < parameters(); ++p) moved[b][p] += std::clamp((*step)[p], -kLargestStep, kLargestStep);
    }
    const Residuals there = residuals_at(moved);
    for (std::size_t b = 0; b < bands(); ++b) {
      const bool improves = cost_of(there[b], moved[b], prior_[b]) < cost_of(here[b], point[b], prior_[b]);
      if (improves) point[b] = moved[b];
      damping[b] = improves ? damping[b] / 4 : damping[b] * 8;
    }
  }

  void finish(const Point& point) {
    const Residuals here = residuals_at(point);
    const auto slopes = derivatives(point, here);
    const FittedRoom found = at(point);
    fitted_.materials = found.materials;
    for (std::size_t b = 0; b < bands(); ++b) {
      fitted_.misfit_after.push_back(misfit(here[b], b));
      const auto variances = equations(slopes[b], here[b], point[b], prior_[b]).variances();
      // Differences beyond the stated errors of the data are the model's: the coefficients are known as much worse.  What the fit took for
      // itself does not count as agreement.
      double taken = static_cast<double>(parameters());
      if (variances)
        for (const double variance : *variances) taken -= variance / (kPriorSpread * kPriorSpread);
      const double free = std::max(1.0, compared(b) - taken);
      const double model = std::max(1.0, fitted_.misfit_after[b] * std::sqrt(std::max(1.0, compared(b)) / free));
      for (std::size_t p = 0; p < parameters(); ++p) {
        const bool is_scattering = p >= materials_.size();
        FittedMaterial& material = fitted_.materials[is_scattering ? p - materials_.size() : p];
        FittedCoefficient& coefficient = is_scattering ? material.scattering[b] : material.absorption[b];
        const double spread = variances ? std::min(kPriorSpread, model * std::sqrt((*variances)[p])) : kPriorSpread;
        coefficient.standard_error = error_at(point[b][p], spread);
      }
    }
  }

  std::shared_ptr<const Scene> scene_;
  const AcousticConfig& acoustics_;
  const MeasuredRoom& room_;
  const MaterialFitConfig& config_;
  std::vector<Material> materials_;
  std::function<void(std::size_t done, std::size_t total)> progress_;
  FittedRoom fitted_;
  Point prior_;
  std::vector<std::vector<OctaveTarget>> targets_;  ///< [place][band]
  std::vector<SoundSource> sources_;
  std::vector<glm::vec3> listeners_;
  std::size_t total_ = 0;
};

nlohmann::ordered_json curve_json(const CoefficientCurve& curve) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (std::size_t i = 0; i < curve.hz.size(); ++i) {
    list.push_back(std::round(1e2 * static_cast<double>(curve.hz[i])) / 1e2);
    list.push_back(std::round(1e5 * static_cast<double>(curve.value[i])) / 1e5);
  }
  return list;
}

nlohmann::ordered_json impedance_json(const Material& material) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (std::size_t i = 0; i < material.impedance_real.hz.size(); ++i)
    for (const float value : {material.impedance_real.hz[i], material.impedance_real.value[i], material.impedance_imaginary.value[i]})
      list.push_back(value);
  return list;
}

std::string errors_text(const std::vector<FittedCoefficient>& coefficients, const std::string& measured) {
  std::string text = "fitted by earshot fit-materials to " + measured + "; standard errors";
  for (const FittedCoefficient& coefficient : coefficients) text += fmt::format(" {:.3f}", coefficient.standard_error);
  return text;
}

}  // namespace

FittedRoom fit_materials(const std::shared_ptr<const Scene>& scene, const AcousticConfig& acoustics, const MeasuredRoom& room,
                         const MaterialFitConfig& config, std::span<const std::size_t> chosen,
                         const std::function<void(std::size_t done, std::size_t total)>& progress) {
  require(config.starts >= 2, "starts", config.starts, "must be at least 2");
  require(config.rounds >= 0, "rounds", config.rounds, "must not be negative");
  return Fit(scene, acoustics, room, config, chosen, progress).run();
}

std::shared_ptr<const Scene> with_materials(const Scene& scene, const FittedRoom& fitted) {
  std::vector<Material> materials = scene.materials();
  for (Material& material : materials) {
    const auto found = std::ranges::find(fitted.materials, material.name, &FittedMaterial::name);
    if (found == fitted.materials.end()) continue;
    material.absorption = curve_of(fitted.bands_hz, found->absorption);
    if (!found->scattering.empty()) material.scattering = curve_of(fitted.bands_hz, found->scattering);
    CoefficientCurve transmission;
    for (const float hz : material.transmission.hz) {
      transmission.hz.push_back(hz);
      transmission.value.push_back(std::min(material.transmission.at(hz), material.absorption.at(hz)));
    }
    material.transmission = std::move(transmission);
  }
  return std::make_shared<const Scene>(scene.name(), scene.mesh(), std::move(materials), scene.air(), scene.import_report());
}

std::string material_file(const Scene& scene, const FittedRoom& fitted, const std::string& measured) {
  const std::shared_ptr<const Scene> changed = with_materials(scene, fitted);
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  std::set<std::string> written;
  for (const Material& material : changed->materials()) {
    if (!written.insert(material.name).second) continue;
    nlohmann::ordered_json entry{{"name", material.name}, {"labels", material.labels}};
    if (material.impedance_real.hz.empty()) {
      entry["absorption"] = curve_json(material.absorption);
      if (material.locally_reacting) entry["angle"] = "locally_reacting";
    } else {
      entry["impedance"] = impedance_json(material);
    }
    entry["scattering"] = curve_json(material.scattering);
    if (!material.transmission.hz.empty()) entry["transmission"] = curve_json(material.transmission);
    if (!material.damping_db_per_m.hz.empty()) entry["damping"] = curve_json(material.damping_db_per_m);
    if (material.speed_m_per_s > 0) entry["speed"] = material.speed_m_per_s;
    if (material.density_kg_per_m3 > 0) entry["density"] = material.density_kg_per_m3;
    const auto found = std::ranges::find(fitted.materials, material.name, &FittedMaterial::name);
    if (found == fitted.materials.end()) {
      entry["source"] = material.source.empty() ? "as in the scene" : material.source;
    } else {
      entry["source"]["absorption"] = errors_text(found->absorption, measured);
      if (!found->scattering.empty()) entry["source"]["scattering"] = errors_text(found->scattering, measured);
    }
    list.push_back(std::move(entry));
  }
  return json_text(nlohmann::ordered_json{{"coefficients", "energy"}, {"materials", list}}, 1) + "\n";
}

}  // namespace earshot
