// SPDX-License-Identifier: Apache-2.0
#include "apps/sound/echogram_svg.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/base/charts/plot_axes.h"
#include "sim/base/charts/svg_document.h"

namespace earshot {
namespace {

constexpr double kFloorDb = -60, kCeilingDb = 5;

struct Kind {
  ArrivalKind kind;
  const char *label, *colour;
};
constexpr std::array<Kind, 4> kKinds{{{ArrivalKind::direct, "direct", "#111111"},
                                      {ArrivalKind::reflection, "reflected", "#2a6fdb"},
                                      {ArrivalKind::diffraction, "diffracted", "#2e9a4f"},
                                      {ArrivalKind::transmission, "through walls", "#d9480f"}}};
constexpr const char* kLateColour = "#c9d2dc";

double db(double ratio) { return 10 * std::log10(std::max(ratio, 1e-12)); }

double energy_of(const Arrival& arrival, int band) { return double{arrival.amplitude[band]} * arrival.amplitude[band]; }

int band_near_1khz(const BandLayout& bands) {
  int best = 0;
  for (int b = 0; b < bands.size(); ++b)
    if (std::abs(std::log(bands.centre_hz[b] / 1000.f)) < std::abs(std::log(bands.centre_hz[best] / 1000.f))) best = b;
  return best;
}

/// Energy per millisecond from emission on, paths included.
std::vector<double> series_of(const AcousticScene& scene, const EnergyResponse& response, int band) {
  constexpr double bin_s = 1e-3;
  std::vector<double> series(static_cast<std::size_t>(std::ceil(scene.config().rir_length_s / bin_s)) + 1, 0.0);
  for (const Arrival& arrival : response.arrivals) {
    const auto bin = static_cast<std::size_t>(arrival.distance_m / response.speed_of_sound_m_per_s / bin_s);
    if (bin < series.size()) series[bin] += energy_of(arrival, band);
  }
  const EnergyHistogram& late = response.late;
  for (std::size_t i = 0; i < series.size() && late.num_bins() > 0; ++i) {
    const auto bin = static_cast<int>((static_cast<double>(i) + 0.5) * bin_s / late.bin_s());
    if (bin < late.num_bins()) series[i] += late.energy(bin, band) * bin_s / late.bin_s();
  }
  return series;
}

std::vector<double> decay_db(const std::vector<double>& series) {
  std::vector<double> edc(series.size());
  energy_decay_curve(series, edc);
  const double whole = edc.empty() ? 0.0 : edc.front();
  for (double& value : edc) value = whole > 0 ? db(value / whole) : kFloorDb;
  return edc;
}

/// Low bands dark, high bands light.
std::string band_colour(int band, int count) {
  const double height = count > 1 ? static_cast<double>(band) / (count - 1) : 0.0;
  return fmt::format("hsl({:.0f} 70% {:.0f}%)", 260 - 220 * height, 32 + 20 * height);
}

void draw_echogram(SvgDocument& svg, const PlotAxes& axes, const EnergyResponse& response, int band) {
  const double speed = response.speed_of_sound_m_per_s;
  const EnergyHistogram& late = response.late;
  double loudest = 0;
  for (const Arrival& arrival : response.arrivals) loudest = std::max(loudest, energy_of(arrival, band));
  const double per_ms = late.num_bins() > 0 ? 1e-3 / late.bin_s() : 0.0;
  if (loudest == 0)
    for (int bin = 0; bin < late.num_bins(); ++bin) loudest = std::max(loudest, late.energy(bin, band) * per_ms);
  if (loudest == 0) return;

  std::vector<SvgPoint> outline{axes.at(0, kFloorDb)};
  for (int bin = 0; bin < late.num_bins(); ++bin) {
    const double level_db = db(late.energy(bin, band) * per_ms / loudest);
    outline.push_back(axes.at(bin * double{late.bin_s()}, level_db));
    outline.push_back(axes.at((bin + 1) * double{late.bin_s()}, level_db));
  }
  outline.push_back({outline.back().x, axes.bottom()});
  svg.polygon(outline, {.fill = kLateColour});
  for (const Arrival& arrival : response.arrivals) {
    const double level_db = db(energy_of(arrival, band) / loudest);
    if (level_db <= kFloorDb) continue;
    const auto kind = std::find_if(kKinds.begin(), kKinds.end(), [&](const Kind& k) { return k.kind == arrival.kind; });
    const SvgPoint top = axes.at(arrival.distance_m / speed, level_db);
    svg.line({top.x, axes.bottom()}, top, {.stroke = kind->colour, .stroke_width = 1.6});
    svg.circle(top, 2.4, {.fill = kind->colour});
  }
}

/// Squares with their labels, from left to right, above a panel.
class Legend {
 public:
  Legend(SvgDocument& svg, SvgPoint at) : svg_(svg), at_(at) {}
  void add(const std::string& label, const std::string& colour) {
    svg_.rectangle({at_.x, at_.y - 9}, 10, 10, {.fill = colour});
    svg_.text({at_.x + 14, at_.y}, label);
    at_.x += 30 + 7 * static_cast<double>(label.size());
  }

 private:
  SvgDocument& svg_;
  SvgPoint at_;
};

}  // namespace

std::string echogram_svg(const std::string& title, const AcousticScene& scene, const EnergyResponse& response) {
  std::vector<std::vector<double>> decays;
  double end_s = 0.05;
  for (int band = 0; band < scene.num_bands(); ++band) {
    decays.push_back(decay_db(series_of(scene, response, band)));
    const auto end = std::find_if(decays.back().begin(), decays.back().end(), [](double level) { return level <= kFloorDb; });
    end_s = std::max(end_s, 1e-3 * static_cast<double>(end - decays.back().begin()));
  }
  end_s = tick_step(end_s) * std::ceil(end_s / tick_step(end_s));
  const int shown = band_near_1khz(scene.bands());
  const PlotScale times{.low = 0, .high = end_s}, levels{.low = kFloorDb, .high = kCeilingDb};
  const PlotAxes paths{.left = 70, .top = 56, .width = 640, .height = 220, .x_scale = times, .y_scale = levels};
  const PlotAxes decay{.left = 70, .top = 330, .width = 640, .height = 200, .x_scale = times, .y_scale = levels};
  SvgDocument svg;
  svg.text({paths.left, 22}, title, {.size_px = 15});
  for (const PlotAxes& axes : {paths, decay}) axes.draw(svg, plot_ticks(times, 1e3), plot_ticks(levels));
  paths.draw_captions(svg, "", "", fmt::format("dB, {:.0f} Hz band", scene.bands().centre_hz[shown]));
  decay.draw_captions(svg, "", "milliseconds after emission", "energy decay, dB");
  Legend kinds(svg, {paths.left, paths.top - 12});
  for (const Kind& kind : kKinds) kinds.add(kind.label, kind.colour);
  kinds.add("late, per millisecond", kLateColour);
  draw_echogram(svg, paths, response, shown);
  Legend bands(svg, {decay.left, decay.top - 12});
  for (int band = 0; band < scene.num_bands(); ++band) {
    const std::string colour = band_colour(band, scene.num_bands());
    bands.add(fmt::format("{:.0f} Hz", scene.bands().centre_hz[band]), colour);
    std::vector<SvgPoint> curve;
    for (std::size_t i = 0; i < decays[band].size() && decays[band][i] > kFloorDb; ++i)
      curve.push_back(decay.at(1e-3 * static_cast<double>(i), decays[band][i]));
    svg.polyline(curve, {.stroke = colour, .stroke_width = 1.6});
  }
  return svg.str(730, 590);
}

}  // namespace earshot
